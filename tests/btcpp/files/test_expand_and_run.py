"""Files run by the executor: expanded into one tree they mean what they mean as they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus
from mrbt_mesh.btcpp.executor.node import FAILURE, RUNNING, SKIPPED, SUCCESS
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.document import Category, parse_document
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.expand import ExpandedNode, constant_value, expand
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library, library_of

CORPUS = Path(__file__).parent / "corpus"
RUNNABLE = sorted(
    path
    for path in CORPUS.glob("*.xml")
    # The others have nodes of their own, or lack a tree.
    if path.stem.startswith(("control_", "decorator_", "leaf_", "subtree_", "v3_", "scripts_"))
    and path.stem not in ("subtree_unresolved", "decorator_custom")
)


class Robot:
    """Runs a library's main tree; notes what its leaves are asked for, and lets them succeed."""

    def __init__(self, library: Library, entries: dict[str, Any]) -> None:
        self.done: list[tuple[str, dict[str, Any]]] = []
        leaves = Leaves()
        leaves.action("*")(self._do)
        self.tree = BehaviorTree(library, None, leaves)
        self.board = self.tree.blackboard
        for name, value in entries.items():
            self.board[name] = value
        self.now_us = 0

    def _do(self, leaf: str, /, **ports: Any) -> None:
        self.done.append((leaf, ports))

    def tick(self) -> NodeStatus:
        return self.tree.executor.tick(self.now_us)


def expanded(library: Library) -> Library:
    """The main tree as one tree without SubTrees."""
    assert library.main_tree is not None
    tree = expand(library, library.main_tree)
    body = Element("BehaviorTree", {"ID": "Main"}, [_element(tree.root)])
    models = [element for document in library.documents for element in document.model_lists]
    root = Element("root", {"BTCPP_format": "4"}, [body, *models[:1]])
    document = parse_document("<root/>", "expanded.xml")
    document.items = [root]
    return library_of(document, Findings())


def _element(node: ExpandedNode) -> Element:
    content = [_element(child) for child in node.children]
    if node.category is Category.SUBTREE:
        return Element("Sequence", dict(node.conditions), list(content))
    return Element(node.type, {**node.ports, **node.conditions}, list(content))


def started(library: Library, **entries: Any) -> tuple[Robot, Robot]:
    """The main tree as it is and expanded, ready to be ticked."""
    assert library.main_tree is not None
    constants = expand(library, library.main_tree).blackboard()
    return Robot(library, entries), Robot(expanded(library), {**constants, **entries})


def ticked(library: Library, **entries: Any) -> Robot:
    """The tree as it is, ticked once; the expanded one does the same."""
    robot, other = started(library, **entries)
    assert robot.tick() is other.tick() is SUCCESS
    assert robot.done == other.done
    return robot


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
    board: dict[str, Any] = {
        "n": 1,
        "wait": 5,
        "pose": 1,
        "mode": "c1",
        "battery": 50,
        "other": 2,
        "x": 1,
    }
    board |= {"y": 2, "dock": "d", "label": "x", "goal": "g", "v": "0.1", "list": "l"}
    robots = started(library, **board)
    statuses: list[NodeStatus] = []
    for _ in range(12):
        first, second = (robot.tick() for robot in robots)
        assert first is second
        statuses.append(first)
        for robot in robots:
            robot.now_us += 1_000_000
    assert robots[0].done == robots[1].done
    assert set(statuses) <= {RUNNING, SUCCESS, FAILURE, SKIPPED}
    if "<Action ID=" in path.read_text():
        assert robots[0].done or "fallback" in path.stem


def test_remapping_and_constants() -> None:
    library, _ = check_file(CORPUS / "subtree_remapping.xml")
    robot = ticked(library, dock="pier", label="x")
    assert robot.done == [("Move", {"goal": "pier", "speed": 0.5})]


def test_autoremap_private_entries_and_explicit_ones() -> None:
    library, _ = check_file(CORPUS / "subtree_autoremap.xml")
    robot = ticked(library, goal="outer", other="there", _own="mine")
    assert [values["goal"] for _, values in robot.done] == ["outer", "there", "dock"]
    assert not any("private" in values for _, values in robot.done)


def test_defaults_of_a_subtrees_model() -> None:
    library, _ = check_file(CORPUS / "subtree_model.xml")
    robot = ticked(library, dock="pier")
    assert robot.done == [("Move", {"goal": "pier", "speed": 0.3})]


def test_nested_subtrees_share_what_is_remapped_and_nothing_else() -> None:
    library, _ = check_file(CORPUS / "subtree_nested.xml")
    robot, other = started(library)
    assert robot.tick() is other.tick() is SUCCESS
    assert {name: robot.board[name] for name in robot.board.names()} == {"a": 1, "x": 3}
    assert (other.board["a"], other.board["x"]) == (1, 3)
    assert len([key for key in other.board.names() if key.endswith("__local")]) == 2


def test_version_3_shares_the_blackboard_where_it_says_so() -> None:
    library, _ = check_file(CORPUS / "v3_subtrees.xml")
    robot = ticked(library, goal="g", v="fast", target="t", speed="slow")
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
    robot = ticked(library, finished=0)
    assert robot.tick() is SUCCESS
    assert len(robot.done) == 1
    assert robot.board["finished"] == 1


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
