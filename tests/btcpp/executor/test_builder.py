"""From a file to nodes: whatever is wrong is told at once, with its place."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus, Out
from mrbt_mesh.errors import FileError


def problems(body: str, trees: str = "", exact: bool = False) -> list[str]:
    leaves = Leaves()

    @leaves.action("Move")
    async def move(goal: str, speed: float = 0.5) -> None: ...

    @leaves.action("Find")
    async def find(where: Out[str]) -> None: ...

    text = (
        '<root BTCPP_format="4" main_tree_to_execute="Main">\n'
        f'<BehaviorTree ID="Main">{body}</BehaviorTree>\n{trees}</root>'
    )
    tree = BehaviorTree.from_text(text, leaves=leaves, exact=exact)
    try:
        tree.check()
    except FileError as error:
        return [str(problem) for problem in error.problems]
    return []


def test_a_leaf_may_have_a_name_that_begins_like_a_node() -> None:
    leaves = Leaves()
    for name in ("SwitchController", "RepeatIt", "Delayed"):
        leaves.action(name)(lambda: True)
    body = "<Sequence><SwitchController/><RepeatIt/><Delayed/></Sequence>"
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    assert BehaviorTree.from_text(text, leaves=leaves).executor.tick(0) is NodeStatus.SUCCESS


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            '<Mvoe goal="a"/>',
            "Main/Mvoe: 'Mvoe' is an action or condition that is not registered; did you mean "
            "'Move'?",
        ),
        ("<Each><AlwaysSuccess/></Each>", "'Each' is a control or decorator that is not regis"),
        ("<Move/>", "Main/Move: Move: port 'goal' is missing"),
        ('<Move goal="a" sped="1"/>', "Move has no port 'sped'; its ports: goal, speed"),
        ('<Find where="here"/>', "Find: port 'where' is written, it needs an entry: {where}"),
        ('<Find where=""/>', "Find: port 'where' is written, it needs an entry: {where}"),
        ("<SpeedController><AlwaysSuccess/></SpeedController>", "the source 'robot_speed'"),
        ('<SubTree ID="Elsewhere"/>', "there is no tree 'Elsewhere'"),
        ('<SubTree ID="In"/>', "port 'goal' of tree 'In' has to be given"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(body: str, message: str) -> None:
    trees = (
        '<BehaviorTree ID="In"><AlwaysSuccess/></BehaviorTree><TreeNodesModel>'
        '<SubTree ID="In"><input_port name="goal"/></SubTree></TreeNodesModel>'
    )
    try:
        (found,) = problems(body, trees)
    except FileError as error:
        found = str(error)
    assert message in found
    assert found.startswith("tree.xml:2: Main/")


def test_all_problems_are_told() -> None:
    found = problems('<Sequence><Move/><Nothing/><Find where="x"/></Sequence>')
    assert len(found) == 3


def test_defaults_of_a_model_serve_a_leaf() -> None:
    model = (
        '<TreeNodesModel><Action ID="Move"><input_port name="goal" default="dock"/></Action>'
        "</TreeNodesModel>"
    )
    assert problems("<Move/>", model) == []


def test_an_exact_tree_refuses_what_the_library_refuses() -> None:
    child = "<AsyncSequence><AlwaysSuccess/></AsyncSequence>"
    body = f"<ReactiveSequence>{child}{child}</ReactiveSequence>"
    assert problems(body) == []
    (found,) = problems(body, exact=True)
    assert "allows one AsyncSequence below a ReactiveSequence" in found


@pytest.mark.parametrize(
    ("value", "port", "refused"),
    [(1, 'n="{k}"', ""), (1, 'x="{k}"', "port 'x' is of type double"), ("a", 'x="{k}"', "")],
)
def test_an_exact_tree_refuses_a_port_of_another_type(value: Any, port: str, refused: str) -> None:
    """As the library does. Otherwise the value is converted."""
    for exact in (True, False):
        text = f'<root BTCPP_format="4"><BehaviorTree ID="M"><Act {port}/></BehaviorTree></root>'
        tree = BehaviorTree.from_text(text, exact=exact)
        tree.action("Act")(_act)
        tree.blackboard["k"] = value
        if refused and exact:
            with pytest.raises(FileError, match=refused):
                tree.check()
        else:
            tree.check()


def _act(n: int = 0, x: float = 0.0) -> None:
    """Its ports are an integer and a real number."""
