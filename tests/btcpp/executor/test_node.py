"""What all nodes have in common: conditions before and after, halting, ports."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp import TickError
from mrbt_mesh.btcpp.executor.node import FAILURE, RUNNING, SKIPPED, SUCCESS
from tests.support.btcpp.ticked import Ticked


def test_preconditions_in_order_and_only_when_idle() -> None:
    scripts = '_skipIf="skip" _successIf="win" _failureIf="fail" _while="go"'
    tree = Ticked(f'<Leaf says="RUNNING" {scripts}/>', {"fail": 1, "win": 1, "skip": 1, "go": 1})
    assert tree.run() == [FAILURE]
    tree.board["fail"] = 0
    assert tree.run() == [SUCCESS]
    tree.board["win"] = 0
    assert tree.run() == [SKIPPED]
    tree.board["skip"] = 0
    assert tree.run() == [RUNNING]
    for name in ("fail", "win", "skip"):
        tree.board[name] = 1
    assert tree.run() == [RUNNING]
    tree.board["go"] = 0
    assert tree.run() == [SKIPPED]
    assert (tree.ticks, tree.halts, tree.is_idle) == ([2], [1], True)


def test_postconditions_and_halting() -> None:
    names = ("_onSuccess", "_onFailure", "_onHalted", "_post")
    scripts = " ".join(f"{name}=\"seen += '{name} '\"" for name in names)
    tree = Ticked(f'<Leaf says="SUCCESS FAILURE RUNNING" {scripts}/>', {"seen": ""})
    tree.run(3)
    tree.executor.halt()
    assert tree.board["seen"].split() == [
        "_onSuccess",
        "_post",
        "_onFailure",
        "_post",
        "_onHalted",
    ]


def test_a_postcondition_runs_for_what_a_precondition_decides_but_not_for_a_skip() -> None:
    body = '<Leaf says="RUNNING" _successIf="a == 1" _skipIf="a == 2" _post="n += 1"/>'
    tree = Ticked(body, {"a": 1, "n": 0})
    assert tree.run() == [SUCCESS]
    tree.board["a"] = 2
    assert tree.run() == [SKIPPED]
    assert tree.board["n"] == 1


def test_an_exact_tree_runs_on_halted_of_idle_nodes_too() -> None:
    leaves = '<Leaf says="RUNNING" _onHalted="n += 1"/><Leaf says="SUCCESS" _onHalted="n += 10"/>'
    found = []
    for exact in (False, True):
        tree = Ticked(f"<Sequence>{leaves}</Sequence>", {"n": 0}, exact=exact)
        tree.run()
        tree.executor.halt()
        found.append(tree.board["n"])
    assert found == [1, 12]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<Sleep msec="{n}"/>', "port 'msec': the entry 'n' has no value"),
        ('<Sleep msec="{word}"/>', "port 'msec': the text 'x' is not an integer"),
        ('<Leaf says="RUNNING" _skipIf="gone"/>', "entry 'gone', in the script 'gone'"),
        ('<Leaf says="RUNNING" _skipIf="word"/>', "'x' is neither true nor false"),
        ('<Leaf says="IDLE"/>', "must not return IDLE"),
    ],
)
def test_what_ends_a_run_is_told_with_its_place(body: str, message: str) -> None:
    with pytest.raises(TickError) as caught:
        Ticked(body, {"word": "x"}).run()
    assert message in str(caught.value)
    assert str(caught.value).startswith("tree.xml:1: Main/")


def test_ports_that_are_given_as_entries_of_other_names() -> None:
    inner = '<BehaviorTree ID="In"><Note what="{=}"/></BehaviorTree>'
    tree = Ticked('<SubTree ID="In" what="{outer}"/>', {"outer": 7}, trees=inner)
    tree.run()
    assert tree.seen == [7]
