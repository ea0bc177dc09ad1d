"""What a drawn tree shows of each node, from BehaviorTree.CPP files and from missions."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.btcpp.files.builtin_nodes import category_of
from mrbt_mesh.btcpp.files.document import (
    SUBTREE,
    Category,
    conditions,
    instance_name,
    ports,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.expand import ExpandedNode
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.core.bt.robot_tree import assignment_tree
from mrbt_mesh.core.bt.tree import CONTROLS, Kind, NodeSpec, Tree
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.views.model.own_trees import local_tree_of
from mrbt_mesh.views.model.program_trees import node_label, program_tree, programs_by_type

MAX_NOTE = 60


class Look(enum.StrEnum):
    """How a node is drawn."""

    CONTROL = "control"
    DECORATOR = "decorator"
    ACTION = "action"
    CONDITION = "condition"
    SUBTREE = "subtree"
    TREE = "tree"


SYMBOLS = {
    "Sequence": "→",
    "AsyncSequence": "→",
    "SequenceWithMemory": "→*",
    "ReactiveSequence": "→↻",
    "Fallback": "?",
    "AsyncFallback": "?",
    "ReactiveFallback": "?↻",
    "Parallel": "⇉",
    "ParallelAll": "⇉",
    "Inverter": "!",
    "RetryUntilSuccessful": "↻",
    "Repeat": "↻",
    "KeepRunningUntilFailure": "↻",
    "Timeout": "◷",
    "Delay": "◷",
}
LOOK_SYMBOLS = {
    Look.CONTROL: "◆",
    Look.DECORATOR: "◇",
    Look.ACTION: "▶",
    Look.CONDITION: "○",
    Look.SUBTREE: "▣",
    Look.TREE: "▤",
}
_LOOKS = {
    Category.ACTION: Look.ACTION,
    Category.CONDITION: Look.CONDITION,
    Category.CONTROL: Look.CONTROL,
    Category.DECORATOR: Look.DECORATOR,
    Category.SUBTREE: Look.SUBTREE,
}


@dataclass(slots=True)
class Shape:
    """A node to draw: a symbol, its label, and notes in small print."""

    look: Look
    label: str
    symbol: str
    notes: list[str] = field(default_factory=list)
    children: list[Shape] = field(default_factory=list)

    def walk(self) -> Iterator[Shape]:
        """This shape and all below it, in preorder."""
        waiting = [self]
        while waiting:
            shape = waiting.pop()
            yield shape
            waiting.extend(reversed(shape.children))

    def to_json(self) -> dict[str, Any]:
        """Plain data, with the children nested."""
        children = [child.to_json() for child in self.children]
        return {
            "type": str(self.look),
            "label": self.label,
            "notes": list(self.notes),
            "children": children,
        }


def file_shapes(library: Library) -> list[Shape]:
    """A shape per <BehaviorTree>, the main one first."""
    main = library.main_tree
    order = sorted(library.trees, key=lambda name: name != main)
    shapes = []
    for name in order:
        notes = ["main tree"] if name == main and len(order) > 1 else []
        source = library.trees[name]
        children = [_element_shape(child, library) for child in source.element.children]
        shapes.append(Shape(Look.TREE, name, LOOK_SYMBOLS[Look.TREE], notes, children))
    return shapes


def _element_shape(element: Element, library: Library) -> Shape:
    name = type_id(element) or element.tag
    category = category_of(name, element.tag, library.models, len(element.children))
    look = _LOOKS[category]
    label = instance_name(element) or element.tag
    if label != name:
        label = f"{label} ({name})"
    notes = [_note(port, value, " = ") for port, value in ports(element).items()]
    notes += [_note(key, script, ": ") for key, script in conditions(element).items()]
    if element.tag == SUBTREE:
        if read_boolean(element.get("_autoremap", "false")):
            notes.append("autoremap")
        if name not in library.trees:
            notes.append("not found")
    symbol = SYMBOLS.get(name, LOOK_SYMBOLS[look])
    children = [_element_shape(child, library) for child in element.children]
    return Shape(look, label, symbol, notes, children)


def _note(name: str, value: str, between: str) -> str:
    text = f"{name}{between}{' '.join(value.split())}"
    return text if len(text) <= MAX_NOTE else text[: MAX_NOTE - 1] + "…"


def mission_shapes(name: str, tree: Tree) -> list[Shape]:
    """The one shape of a mission's tree."""
    child = _spec_shape(tree.spec(), tree, 0)[0]
    return [Shape(Look.TREE, name, LOOK_SYMBOLS[Look.TREE], ["T_G"], [child])]


def robot_shape(mission: Mission, robot: str) -> Shape:
    """T_i = Parallel(T_A, T_G, T_Li, 3) of a robot of the mission."""
    capabilities = mission.robots[robot].capabilities
    local = local_tree_of(mission, capabilities)
    parts = [
        _named("T_A", assignment_tree(), "task assignment"),
        _named("T_G", mission.tree, "global tasks, the same for all robots"),
        _named("T_Li", local, f"what {robot} can do"),
    ]
    for leaf in parts[2].walk():
        if leaf.look is Look.ACTION:
            leaf.notes += [
                f"p = {value / MICRO:g}" if name == leaf.label else f"{name}: p = {value / MICRO:g}"
                for name, value in sorted(capabilities.items())
                if type_name(name) == leaf.label
            ]
    programs = programs_by_type(mission)
    for leaf in list(parts[2].walk()):
        if leaf.look is Look.ACTION and leaf.label in programs:
            program = programs[leaf.label]
            leaf.look, leaf.symbol = Look.SUBTREE, LOOK_SYMBOLS[Look.SUBTREE]
            leaf.notes.append(f"{program.source}#{program.tree}")
            leaf.children = [_expanded_shape(program_tree(program))]
    kind = Kind.PARALLEL
    whole = Shape(Look.CONTROL, f"T_i ({kind} {len(parts)}/{len(parts)})", SYMBOLS[kind])
    whole.children = parts
    return Shape(Look.TREE, robot, LOOK_SYMBOLS[Look.TREE], [mission.name], [whole])


def _named(name: str, tree: Tree, note: str) -> Shape:
    child = _spec_shape(tree.spec(), tree, 0)[0]
    return Shape(Look.SUBTREE, name, LOOK_SYMBOLS[Look.SUBTREE], [note], [child])


def _expanded_shape(node: ExpandedNode) -> Shape:
    look = _LOOKS[node.category]
    symbol = SYMBOLS.get(node.type, LOOK_SYMBOLS[look])
    children = [_expanded_shape(child) for child in node.children]
    notes = [_note(key, script, ": ") for key, script in node.conditions.items()]
    return Shape(look, node_label(node), symbol, notes, children)


def _spec_shape(spec: NodeSpec, tree: Tree, index: int) -> tuple[Shape, int]:
    """The shape of the node at `index`, and the index behind its last descendant."""
    if spec.kind in CONTROLS:
        look = Look.CONTROL
    else:
        looks = {
            Kind.ACTION: Look.ACTION,
            Kind.CONDITION: Look.CONDITION,
            Kind.SUBTREE: Look.SUBTREE,
        }
        look = looks.get(spec.kind, Look.DECORATOR)
    symbol = SYMBOLS.get(spec.kind, LOOK_SYMBOLS[look])
    shape = Shape(look, tree.nodes[index].label, symbol)
    index += 1
    for child in spec.children:
        inner, index = _spec_shape(child, tree, index)
        shape.children.append(inner)
    return shape, index
