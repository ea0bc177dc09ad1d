"""BehaviorTree.CPP's own leaves."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.btcpp import TickError
from mrbt_mesh.btcpp.executor.node import FAILURE, SUCCESS
from tests.support.btcpp.ticked import Ticked


def entries(tree: Ticked) -> dict[str, Any]:
    return {name: tree.board.get(name) for name in tree.board.names()}


def test_scripts_and_their_conditions() -> None:
    repeat = '<Repeat num_cycles="9"><Leaf says="SUCCESS" _skipIf="n > 2" _onSuccess="n += 1"/>'
    body = f'<Script code="n := 1"/>{repeat}</Repeat><ScriptCondition code="n == 3"/>'
    tree = Ticked(f"<Sequence>{body}</Sequence>", yields=False)
    assert tree.run() == [SUCCESS]
    assert entries(tree) == {"n": 3}
    assert Ticked('<ScriptCondition code="0"/>').run() == [FAILURE]
    assert Ticked('<ScriptCondition code="RED == 1"/>', enums={"RED": 1}).run() == [SUCCESS]


def test_code_may_come_from_the_blackboard() -> None:
    tree = Ticked('<Script code="{code}"/>', {"code": "n := 1"})
    tree.run()
    tree.board["code"] = "n := 'two"
    with pytest.raises(TickError, match=r"Main/Script: .* not closed.*, in the script"):
        tree.run()
    assert tree.board["n"] == 1


def test_set_blackboard_copies_entries_and_stores_constants_as_texts() -> None:
    tree = Ticked('<SetBlackboard value="{source}" output_key="k"/>', {"source": 7})
    assert tree.run() == [SUCCESS]
    assert tree.board["k"] == 7
    tree = Ticked('<SetBlackboard value="42" output_key="k"/>')
    tree.run()
    assert tree.board["k"] == "42"


def test_set_blackboard_reads_a_constant_as_the_entrys_type() -> None:
    body = '<SetBlackboard value="42" output_key="k"/><Sleep msec="{k}"/>'
    tree = Ticked(f"<Sequence>{body}</Sequence>")
    tree.run()
    assert tree.board["k"] == 42


def test_set_blackboard_without_a_value() -> None:
    assert Ticked('<SetBlackboard value="{none}" output_key="k"/>').run() == [FAILURE]
    with pytest.raises(TickError, match="port 'output_key': the entry 'k' has no value"):
        Ticked('<SetBlackboard value="1" output_key="{k}"/>').run()


def test_unset_blackboard() -> None:
    tree = Ticked('<UnsetBlackboard key="k"/>', {"k": 1})
    assert tree.run(2) == [SUCCESS, SUCCESS]
    assert "k" not in tree.board


def test_was_entry_updated() -> None:
    tree = Ticked('<WasEntryUpdated entry="{x}"/>')
    assert tree.run() == [FAILURE]
    for _ in range(2):
        tree.board["x"] = 1
        assert tree.run(2) == [SUCCESS, FAILURE]
