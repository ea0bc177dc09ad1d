"""Files run in the reference interpreter: they mean what BehaviorTree.CPP does with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.formats.btcpp.check import check_file
from mrbt_mesh.formats.btcpp.document import LEAVES, Category, parse_document
from mrbt_mesh.formats.btcpp.expand import ExpandedNode, constant_value, expand
from mrbt_mesh.formats.btcpp.findings import Findings
from mrbt_mesh.formats.btcpp.library import Library, library_of
from tests.support.btcpp.interpreter import (
    FAILURE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Blackboard,
    Node,
    Status,
    World,
    tick,
)

CORPUS = Path(__file__).parent / "corpus"
RUNNABLE = sorted(
    path
    for path in CORPUS.glob("*.xml")
    # The others have nodes of their own, or lack a tree.
    if path.stem.startswith(("control_", "decorator_", "leaf_", "subtree_", "v3_", "scripts_"))
    and path.stem not in ("subtree_unresolved", "decorator_custom")
)


class Robot:
    """Carries out every leaf: notes it with its ports and returns SUCCESS."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.done: list[tuple[str, dict[str, Any]]] = []

    def leaf(self, node: ExpandedNode) -> Callable[[], Status]:
        def script() -> Status:
            board = self.world.blackboard
            values = {
                port: board.get(value[1:-1]) if value.startswith("{") else value
                for port, value in node.ports.items()
            }
            self.done.append((node.type, values))
            return SUCCESS

        return script

    def node(self, node: ExpandedNode) -> Node:
        """The interpreter's form of a node and all below it."""
        kind: str = node.type
        if node.category is Category.SUBTREE:
            kind = "SubTree"
        elif node.category in LEAVES and not _is_builtin_leaf(node.type):
            kind = "Action"
        children = [self.node(child) for child in node.children]
        conditions: dict[str, Any] = dict(node.conditions)
        return Node(kind, children, dict(node.ports), conditions, self.leaf(node), node.name)


def _is_builtin_leaf(name: str) -> bool:
    return name.startswith(("Always", "Script", "SetBlack", "UnsetBlack", "Sleep", "WasEntry"))


def started(library: Library, **entries: Any) -> tuple[Node, World, Robot]:
    """The main tree, ready to be ticked."""
    assert library.main_tree is not None
    tree = expand(library, library.main_tree)
    world = World(Blackboard({**tree.blackboard(), **entries}), yields=True)
    robot = Robot(world)
    return robot.node(tree.root), world, robot


def from_text(body: str, trees: str = "") -> Library:
    text = (
        '<root BTCPP_format="4" main_tree_to_execute="Main">'
        f'<BehaviorTree ID="Main">{body}</BehaviorTree>{trees}</root>'
    )
    return library_of(parse_document(text, "m.xml"), Findings())


@pytest.mark.parametrize("path", RUNNABLE, ids=lambda path: path.stem)
def test_files_of_the_corpus_run(path: Path) -> None:
    library, _ = check_file(path)
    if library.main_tree is None:
        return
    board = {"n": 1, "wait": 5, "pose": 1, "mode": "c1", "battery": 50, "other": 2, "a": 1, "x": 1}
    root, world, robot = started(
        library, **board, y=2, dock="d", label="x", goal="g", v="0.1", b="s"
    )
    statuses = []
    for _ in range(12):
        statuses.append(tick(root, world))
        world.now_ms += 1000
    assert set(statuses) <= {RUNNING, SUCCESS, FAILURE, SKIPPED}
    if "<Action ID=" in path.read_text():
        assert robot.done or "fallback" in path.stem


def test_remapping_and_constants() -> None:
    library, _ = check_file(CORPUS / "subtree_remapping.xml")
    root, world, robot = started(library, dock="pier", label="x")
    assert tick(root, world) is SUCCESS
    assert robot.done == [("Move", {"goal": "pier", "speed": 0.5})]


def test_autoremap_private_entries_and_explicit_ones() -> None:
    library, _ = check_file(CORPUS / "subtree_autoremap.xml")
    root, world, robot = started(library, goal="outer", other="there", _own="mine")
    assert tick(root, world) is SUCCESS
    goals = [values for _, values in robot.done]
    assert goals == [
        {"goal": "outer", "private": None},
        {"goal": "there", "private": None},
        {"goal": "dock", "private": None},
    ]


def test_defaults_of_a_subtrees_model() -> None:
    library, _ = check_file(CORPUS / "subtree_model.xml")
    root, world, robot = started(library, dock="pier")
    assert tick(root, world) is SUCCESS
    assert robot.done == [("Move", {"goal": "pier", "speed": 0.3})]


def test_nested_subtrees_share_what_is_remapped_and_nothing_else() -> None:
    library, _ = check_file(CORPUS / "subtree_nested.xml")
    root, world, _ = started(library)
    assert tick(root, world) is SUCCESS
    assert world.blackboard["a"] == 1
    assert world.blackboard["x"] == 3
    own = [key for key in world.blackboard if key.endswith("__local")]
    assert len(own) == 2


def test_version_3_shares_the_blackboard_where_it_says_so() -> None:
    library, _ = check_file(CORPUS / "v3_subtrees.xml")
    root, world, robot = started(library, goal="g", v="fast", target="t", speed="slow")
    assert tick(root, world) is SUCCESS
    assert [values for _, values in robot.done] == [
        {"target": "g", "speed": "fast"},
        {"target": "t", "speed": "slow"},
        {"target": "g", "speed": 0.5},
    ]


def test_conditions_see_the_blackboard_of_their_own_tree() -> None:
    trees = (
        '<BehaviorTree ID="Go"><Sequence><Act _skipIf="done" _onSuccess="done = true"/>'
        '<ScriptCondition code="done"/></Sequence></BehaviorTree>'
    )
    library = from_text('<SubTree ID="Go" done="{finished}"/>', trees)
    root, world, robot = started(library, finished=0)
    assert tick(root, world) is SUCCESS
    assert tick(root, world) is SUCCESS
    assert len(robot.done) == 1
    assert world.blackboard["finished"] == 1


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("-7", -7),
        (str(2**40), 2**40),
        (str(2**70), float(2**70)),
        ("2.50", 2.5),
        ("1e3", 1000.0),
        ("dock", "dock"),
        ("1;2", "1;2"),
        ("", ""),
    ],
)
def test_constants_are_numbers_where_they_look_like_numbers(text: str, value: Any) -> None:
    found = constant_value(text)
    assert found == value
    assert type(found) is type(value)
