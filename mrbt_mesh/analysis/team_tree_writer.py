"""Writes a team's tree T_G as BehaviorTree.CPP XML."""

from __future__ import annotations

import re
from collections.abc import Iterable

from mrbt_mesh.analysis.team_tree import KINDS, REACTIVE
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.document import MODELS, SUBTREE, TREE, Document
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.loadable import loadable
from mrbt_mesh.core.bt.tree import LEAVES as CORE_LEAVES
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.features.values.blackboard import EntryComparison, comparison_of

_SIGN = re.compile(r"[^A-Za-z0-9_]+")
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")
# The core's kinds, with BehaviorTree.CPP's names.
_OF_KIND = {kind: node for node, kind in reversed(KINDS.items())} | {
    (Kind.PARALLEL, Memory.NONE): "Parallel",
    (Kind.JOBS, Memory.NONE): "Parallel",
}


def team_tree_document(spec: NodeSpec, file: str) -> Document:
    """Return a team's tree T_G as BehaviorTree.CPP XML; `team_tree.to_team_tree` reads it back.

    Sequences and Fallbacks without memory become reactive ones; BehaviorTree.CPP has no such
    Parallel, so those are marked `_reactive`. Tasks become actions with their arguments as ports
    `arg_1`, `arg_2`, ...; a team's bounds and robots cannot be expressed. A Jobs node becomes a
    Parallel of its types, a comparison of a blackboard entry a ScriptCondition, and an argument
    that is read from the blackboard a pointer to it.
    """
    root = Element("root", {"BTCPP_format": "4", "main_tree_to_execute": "MainTree"})
    writer = _CoreWriter()
    main = Element(TREE, {"ID": "MainTree"}, [writer.element(spec)])
    root.content = [main, *writer.trees.values()]
    models = writer.models()
    if models.content:
        root.content.append(models)
    return loadable(Document(file, [root]))


class _CoreWriter:
    def __init__(self) -> None:
        self.trees: dict[NodeSpec, Element] = {}
        self.names: set[str] = {"MainTree"}
        self.leaves: dict[str, tuple[Kind, int]] = {}

    def element(self, spec: NodeSpec) -> Element:
        if spec.kind in CORE_LEAVES:
            return self.leaf(spec)
        if spec.kind is Kind.SUBTREE:
            attributes = {"ID": self.subtree(spec)}
            if spec.name not in ("", attributes["ID"]):
                attributes["name"] = spec.name
            return Element(SUBTREE, attributes)
        element = Element(_OF_KIND[spec.kind, spec.memory])
        if name := spec.name or (str(Kind.JOBS) if spec.kind is Kind.JOBS else ""):
            element.attributes["name"] = name
        element.attributes |= _limits(spec)
        element.content = [self.element(child) for child in spec.children]
        return element

    def subtree(self, spec: NodeSpec) -> str:
        """Return the ID of the tree for a subtree; equal subtrees share it."""
        if spec not in self.trees:
            wanted = "".join(c if c.isalnum() or c in "_-" else "_" for c in spec.name).strip("_")
            name = wanted = wanted or "subtree"
            number = 1
            while name in self.names or name in BUILTIN or name in self.leaves:
                number += 1
                name = f"{wanted}_{number}"
            self.names.add(name)
            tree = self.trees[spec] = Element(TREE, {"ID": name})
            tree.content = [self.element(child) for child in spec.children]
        return self.trees[spec].get("ID")

    def leaf(self, spec: NodeSpec) -> Element:
        comparison = comparison_of(spec.subject) if spec.kind is Kind.CONDITION else None
        if comparison is not None:
            return Element("ScriptCondition", {"code": _script(comparison), "name": spec.subject})
        name = type_name(spec.subject)
        arguments = spec.subject[len(name) + 1 : -1].split(",") if "(" in spec.subject else []
        kind = "Condition" if spec.kind is Kind.CONDITION else "Action"
        before = self.leaves.get(name)
        self.leaves[name] = (spec.kind, max(len(arguments), before[1] if before else 0))
        attributes = {"ID": name, "name": spec.name or spec.subject}
        pointers = [f"{{{text[1:]}}}" if text.startswith("$") else text for text in arguments]
        attributes |= {f"arg_{number + 1}": text for number, text in enumerate(pointers)}
        return Element(kind, attributes)

    def models(self) -> Element:
        found: Iterable[tuple[str, tuple[Kind, int]]] = sorted(self.leaves.items())
        models = Element(MODELS)
        for name, (kind, count) in found:
            model = Element("Condition" if kind is Kind.CONDITION else "Action", {"ID": name})
            model.content = [
                Element("input_port", {"name": f"arg_{number + 1}", "type": "std::string"})
                for number in range(count)
            ]
            models.content.append(model)
        return models


def _script(comparison: EntryComparison) -> str:
    """Return a comparison for BehaviorTree.CPP's scripts: texts in quotes, names without signs."""
    is_number = _NUMBER.fullmatch(comparison.literal) is not None
    literal = comparison.literal if is_number else f"'{comparison.literal}'"
    return f"{_SIGN.sub('_', comparison.entry)} {comparison.operator} {literal}"


def _limits(spec: NodeSpec) -> dict[str, str]:
    if spec.kind is Kind.PARALLEL:
        fails_at = spec.failures or len(spec.children) - spec.limit + 1
        counts = {"success_count": str(spec.limit), "failure_count": str(fails_at)}
        return counts | ({REACTIVE: "true"} if spec.memory is Memory.NONE else {})
    if spec.kind is Kind.JOBS:
        return {"success_count": str(len(spec.children)), "failure_count": "1"}
    if spec.kind is Kind.RETRY:
        return {"num_attempts": str(spec.limit)}
    if spec.kind is Kind.REPEAT:
        return {"num_cycles": str(spec.limit)}
    if spec.kind is Kind.TIMEOUT:
        # Whole milliseconds; never less than the mission allows.
        return {"msec": str(-(-spec.timeout_us // 1000))}
    return {}
