"""The nodes of a drawn tree, from BehaviorTree.CPP files and from missions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrbt_mesh.btcpp.files.builtin_nodes import category_of
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.document import (
    SUBTREE,
    conditions,
    instance_name,
    ports,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.expand import ExpandedNode
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.cli.options import chosen_robots
from mrbt_mesh.cli.terminal import warn
from mrbt_mesh.core.bt.robot_tree import assignment_tree
from mrbt_mesh.core.bt.tree import CONTROLS, Kind, Tree
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.views.model.inner_trees import node_label, program_tree, trees_by_type
from mrbt_mesh.views.model.own_trees import OwnTrees

MAX_NOTE = 60
# How nodes are drawn, with a sign for kinds without a sign of their own. A node of a team that is
# none of these is a decorator.
LOOKS = {
    "control": "◆",
    "decorator": "◇",
    "action": "▶",
    "condition": "○",
    "subtree": "▣",
    "tree": "▤",
}
SYMBOLS = {
    **dict.fromkeys(("Sequence", "AsyncSequence"), "→"),
    **dict.fromkeys(("Fallback", "AsyncFallback"), "?"),
    **dict.fromkeys(("Parallel", "ParallelAll"), "⇉"),
    **dict.fromkeys(("RetryUntilSuccessful", "Repeat", "KeepRunningUntilFailure"), "↻"),
    **dict.fromkeys(("Timeout", "Delay"), "◷"),
    "SequenceWithMemory": "→*",
    "ReactiveSequence": "→↻",
    "ReactiveFallback": "?↻",
    "Inverter": "!",
}


@dataclass(slots=True)
class Shape:
    """A node to draw: its look, its label, a symbol (default: the look's), small notes."""

    look: str
    label: str
    symbol: str = ""
    notes: list[str] = field(default_factory=list)
    children: list[Shape] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.symbol = self.symbol or LOOKS[self.look]

    def walk(self) -> Iterator[Shape]:
        """Yield this shape and all shapes below it, in preorder."""
        waiting = [self]
        while waiting:
            shape = waiting.pop()
            yield shape
            waiting.extend(reversed(shape.children))

    def to_json(self) -> dict[str, Any]:
        """Return plain data, with the children nested."""
        children = [child.to_json() for child in self.children]
        return {"type": self.look, "label": self.label, "notes": self.notes, "children": children}


def is_mission(path: Path) -> bool:
    """Return whether a file is a mission, by its name. Raises InputError if it can be no tree."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name one file in it")
    suffix = path.suffix.lower()
    if suffix not in (".xml", ".yaml", ".yml", ".json"):
        raise InputError(f"{path}: a tree is in a file that ends in .xml, .yaml, .yml or .json")
    return suffix != ".xml"


def shapes_of(file: Path, only: str | None, robots: str | None) -> list[Shape]:
    """Return the trees of a file.

    All of them, `only` the one of an ID, or T_i of `robots` of a mission (`A1,B1`). Raises
    InputError for a file or tree that is missing or cannot be read. A file with errors is drawn as
    far as possible, with a warning.
    """
    if robots is not None:
        if not is_mission(file):
            raise InputError(f"{file}: --robot is for mission files (.yaml), which name robots")
        mission = load_mission(file)
        return [robot_shape(mission, robot) for robot in chosen_robots("--robot", robots, mission)]
    if is_mission(file):
        mission = load_mission(file)
        shapes = [Shape("tree", mission.name, notes=["T_G"], children=[_team_shape(mission.tree)])]
    else:
        library, findings = check_file(file)
        if findings.errors:
            count = len(findings.errors)
            what = "an error" if count == 1 else f"{count} errors"
            warn(f"{what} in {file}: mrbt tree check lists all")
        shapes = file_shapes(library)
    chosen = [shape for shape in shapes if only in (None, shape.label)]
    if only is not None and not chosen:
        known = ", ".join(shape.label for shape in shapes)
        raise InputError(f"{file}: there is no tree {only!r}; known: {known}")
    return chosen


def file_shapes(library: Library) -> list[Shape]:
    """Return a shape per <BehaviorTree>, the main one first."""
    main = library.main_tree
    order = sorted(library.trees, key=lambda name: name != main)
    return [
        Shape(
            "tree",
            name,
            notes=["main tree"] if name == main and len(order) > 1 else [],
            children=[_element_shape(e, library) for e in library.trees[name].element.children],
        )
        for name in order
    ]


def _element_shape(element: Element, library: Library) -> Shape:
    name = type_id(element) or element.tag
    category = category_of(name, element.tag, library.models, len(element.children))
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
    children = [_element_shape(child, library) for child in element.children]
    return Shape(category.lower(), label, SYMBOLS.get(name, ""), notes, children)


def _note(name: str, value: str, between: str) -> str:
    text = f"{name}{between}{' '.join(value.split())}"
    return text if len(text) <= MAX_NOTE else text[: MAX_NOTE - 1] + "…"


def robot_shape(mission: Mission, robot: str) -> Shape:
    """Return T_i = Parallel(T_A, T_G, T_Li, 3) of a robot of the mission."""
    capabilities = mission.robots[robot].capabilities
    parts = [
        Shape("subtree", name, notes=[note], children=[_team_shape(tree)])
        for name, tree, note in (
            ("T_A", assignment_tree(), "task assignment"),
            ("T_G", mission.tree, "global tasks, the same for all robots"),
            ("T_Li", OwnTrees(robot, capabilities).local, f"what {robot} can do"),
        )
    ]
    trees = trees_by_type(mission)
    for leaf in [each for each in parts[2].walk() if each.look == "action"]:
        leaf.notes += [
            f"p = {value / MICRO:g}" if name == leaf.label else f"{name}: p = {value / MICRO:g}"
            for name, value in sorted(capabilities.items())
            if type_name(name) == leaf.label
        ]
        if leaf.label in trees:
            tree = trees[leaf.label]
            leaf.look, leaf.symbol = "subtree", LOOKS["subtree"]
            leaf.notes.append(f"{tree.source}#{tree.tree}")
            leaf.children = [_expanded_shape(program_tree(tree))]
    kind = Kind.PARALLEL
    whole = Shape("control", f"T_i ({kind} {len(parts)}/{len(parts)})", SYMBOLS[kind], [], parts)
    return Shape("tree", robot, notes=[mission.name], children=[whole])


def _expanded_shape(node: ExpandedNode) -> Shape:
    children = [_expanded_shape(child) for child in node.children]
    notes = [_note(key, script, ": ") for key, script in node.conditions.items()]
    look = node.category.lower()
    return Shape(look, node_label(node), SYMBOLS.get(node.type, ""), notes, children)


def _team_shape(tree: Tree, index: int = 0) -> Shape:
    """Return the shape of the node at `index` of a mission's tree, or of a similar tree."""
    node = tree.nodes[index]
    look = "control" if node.kind in CONTROLS else node.kind.lower()
    children = [_team_shape(tree, child) for child in node.children]
    symbol = SYMBOLS.get(node.kind, "")
    return Shape(look if look in LOOKS else "decorator", node.label, symbol, [], children)
