"""Write trees so that Groot2 can open them: the explicit form, and models of all nodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mrbt_mesh.core.bt.tree import LEAVES as CORE_LEAVES
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.formats.btcpp.builtin_nodes import BUILTIN, category_of
from mrbt_mesh.formats.btcpp.document import (
    EXPLICIT_TAGS,
    INCLUDE,
    MODELS,
    SUBTREE,
    TREE,
    Document,
    NodeManifest,
    instance_name,
    pointer,
    ports,
    type_id,
)
from mrbt_mesh.formats.btcpp.elements import Content, Element, Text
from mrbt_mesh.formats.btcpp.expand import expand
from mrbt_mesh.formats.btcpp.library import Library, TreeSource
from mrbt_mesh.formats.btcpp.loadable import loadable
from mrbt_mesh.formats.btcpp.team_tree import KINDS, REACTIVE
from mrbt_mesh.formats.btcpp.xml_reader import TreeFileError
from mrbt_mesh.formats.problems import Problem

# The core's kinds as BehaviorTree.CPP calls them.
_OF_KIND = {kind: node for node, kind in reversed(KINDS.items())} | {
    (Kind.PARALLEL, Memory.NONE): "Parallel"
}


def explicit(library: Library, *, is_merged: bool = False) -> Document:
    """The first document in the explicit form, with models of all nodes that it uses.

    A lone tree without an ID gets none: beside models BehaviorTree.CPP would want its ID. With
    `is_merged` the trees of all included files are in it, and no <include> is left.
    """
    document = library.documents[0].copy()
    if is_merged:
        _merge(document, library)
    for tree in document.trees:
        for element in tree.walk():
            if element is not tree:
                _make_explicit(element, library)
    if all(tree.get("ID") for tree in document.trees):
        _add_models(document, library)
    return document


def _make_explicit(element: Element, library: Library) -> None:
    name = type_id(element)
    category = category_of(name, element.tag, library.models, len(element.children))
    if element.tag in EXPLICIT_TAGS:
        element.tag = category
        return
    element.tag = category
    kept = {key: value for key, value in element.attributes.items() if key != "ID"}
    element.attributes = {"ID": name} | kept


def _merge(document: Document, library: Library) -> None:
    root = document.root
    here = {tree.get("ID") for tree in document.trees}
    without: list[Content] = [
        item
        for item in root.content
        if not (isinstance(item, Element) and item.tag in (INCLUDE, MODELS))
    ]
    for name, source in library.own_trees.items():
        if name not in here and source.document is not library.documents[0]:
            without.append(source.element.copy())
    root.content = [
        *without,
        *(item.copy() for d in library.documents for item in d.model_lists[:1]),
    ]
    lists = document.model_lists
    for extra in lists[1:]:
        lists[0].content.extend(extra.content)
        root.content.remove(extra)


def _add_models(document: Document, library: Library) -> None:
    """Describe each node that the document uses and nobody describes yet."""
    described = set(document.models())
    uses: dict[str, list[Element]] = {}
    for tree in document.trees:
        for element in tree.walk():
            name = type_id(element)
            is_custom = element.tag in EXPLICIT_TAGS - {SUBTREE} and name not in BUILTIN
            if is_custom and name not in described:
                uses.setdefault(name, []).append(element)
    if not uses:
        return
    if not document.model_lists:
        document.root.content.append(Element(MODELS))
    models = document.model_lists[0]
    for name in sorted(uses):
        known = library.models.get(name)
        models.content.append(model_element(known) if known else _guessed_model(name, uses[name]))


def model_element(model: NodeManifest) -> Element:
    """A model as it stands in <TreeNodesModel>."""
    element = Element(model.category, {"ID": model.id})
    if model.description:
        element.content.append(Element("description", {}, [Text(model.description)]))
    for port in model.ports.values():
        attributes = {"name": port.name}
        if port.type:
            attributes["type"] = port.type
        if port.default is not None:
            attributes["default"] = port.default
        content: list[Content] = [Text(port.description)] if port.description else []
        element.content.append(Element(port.direction, attributes, content))
    return element


def _guessed_model(name: str, uses: list[Element]) -> Element:
    """A model from a node's uses. Ports that are given blackboard entries may be written."""
    element = Element(uses[0].tag, {"ID": name})
    found: dict[str, bool] = {}
    for use in uses:
        for port, value in ports(use).items():
            found[port] = found.get(port, False) or pointer(value, port) is not None
    for port, has_pointer in found.items():
        tag = "inout_port" if has_pointer else "input_port"
        element.content.append(Element(tag, {"name": port}))
    return element


def with_ids(library: Library) -> Document:
    """One <BehaviorTree> per SubTree in use, with `_fullpath`, and `_uid` at every node.

    As BehaviorTree.CPP tells a monitor which node is which: nodes are numbered from 1, depth first,
    those of a SubTree right after it. Raises TreeFileError without a main tree, and for a tree that
    cannot be expanded.
    """
    first = library.documents[0]
    main = library.main_tree
    if main is None:
        message = "main_tree_to_execute has to name a tree"
        raise TreeFileError([Problem(first.file, first.root.line, "root", message)])
    # Refuses trees that contain themselves, or that are too large.
    expand(library, main)
    root = Element("root", {"BTCPP_format": "4", "main_tree_to_execute": main})

    def begin(source: TreeSource, path: str) -> tuple[Iterator[Element], str]:
        tree = Element(TREE, {"ID": source.id, "_fullpath": path})
        tree.content = [child.copy() for child in source.element.children]
        root.content.append(tree)
        return (element for child in tree.children for element in child.walk()), path

    uid, open_trees = 0, [begin(library.trees[main], "")]
    while open_trees:
        elements, path = open_trees[-1]
        element = next(elements, None)
        if element is None:
            open_trees.pop()
            continue
        uid += 1
        _make_explicit(element, library)
        element.attributes["_uid"] = str(uid)
        if element.tag != SUBTREE:
            element.attributes.setdefault("name", instance_name(element))
            continue
        inner = element.get("ID")
        own = element.get("name") or f"{inner}::{uid}"
        element.attributes["_fullpath"] = full = f"{path}/{own}" if path else own
        if inner in library.trees:
            open_trees.append(begin(library.trees[inner], full))
    document = Document(first.file, [root])
    _add_models(document, library)
    return document


def team_tree_document(spec: NodeSpec, file: str) -> Document:
    """A team's tree T_G as BehaviorTree.CPP XML; `team_tree.to_team_tree` takes it back.

    Sequences and Fallbacks without memory become reactive ones; BehaviorTree.CPP has no such
    Parallel, so those are marked `_reactive`. Tasks become actions with their arguments as ports
    `arg_1`, `arg_2`, ...; a team's bounds and robots have no place.
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
        if spec.name:
            element.attributes["name"] = spec.name
        element.attributes |= _limits(spec)
        element.content = [self.element(child) for child in spec.children]
        return element

    def subtree(self, spec: NodeSpec) -> str:
        """The ID of the tree for a subtree; equal ones share it."""
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
        name = type_name(spec.subject)
        arguments = spec.subject[len(name) + 1 : -1].split(",") if "(" in spec.subject else []
        kind = "Condition" if spec.kind is Kind.CONDITION else "Action"
        before = self.leaves.get(name)
        self.leaves[name] = (spec.kind, max(len(arguments), before[1] if before else 0))
        attributes = {"ID": name, "name": spec.name or spec.subject}
        attributes |= {f"arg_{number + 1}": text for number, text in enumerate(arguments)}
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


def _limits(spec: NodeSpec) -> dict[str, str]:
    if spec.kind is Kind.PARALLEL:
        fails_at = spec.failures or len(spec.children) - spec.limit + 1
        counts = {"success_count": str(spec.limit), "failure_count": str(fails_at)}
        return counts | ({REACTIVE: "true"} if spec.memory is Memory.NONE else {})
    if spec.kind is Kind.RETRY:
        return {"num_attempts": str(spec.limit)}
    if spec.kind is Kind.REPEAT:
        return {"num_cycles": str(spec.limit)}
    if spec.kind is Kind.TIMEOUT:
        # Whole milliseconds; never less than the mission allows.
        return {"msec": str(-(-spec.timeout_us // 1000))}
    return {}
