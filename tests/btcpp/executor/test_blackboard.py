"""Blackboards: remapping, types, writes."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.btcpp import Blackboard, BlackboardError

NAMES = st.sampled_from(["a", "b", "_p", "@a", "c"])


def test_entries_are_remapped_to_the_parent_and_further() -> None:
    root = Blackboard()
    middle = Blackboard(root)
    inner = Blackboard(middle)
    middle.remapped["goal"] = "dock"
    inner.remapped["target"] = "goal"
    root["dock"] = "pier"
    assert inner["target"] == "pier"
    inner["target"] = "berth"
    assert (root["dock"], middle["goal"]) == ("berth", "berth")
    inner["own"] = 1
    assert list(root.names()) == ["dock"]
    assert "own" not in middle


def test_autoremap_leaves_private_entries_and_constants_alone() -> None:
    root = Blackboard()
    inner = Blackboard(root, autoremap=True)
    inner["shared"] = 1
    inner["_private"] = 2
    inner.own("constant", 3)
    root["constant"] = 4
    assert dict.fromkeys(root.names()) == {"constant": None, "shared": None}
    assert (inner["constant"], root["constant"]) == (3, 4)
    assert "_private" not in root


def test_the_roots_entries_from_anywhere() -> None:
    root = Blackboard()
    inner = Blackboard(Blackboard(root))
    inner["@top"] = 5
    assert root["top"] == 5
    assert inner["@top"] == 5
    inner.unset("@top")
    assert root.get("top", "none") == "none"


def test_an_entrys_type_stays() -> None:
    board = Blackboard()
    board.declare("n", "int")
    board["n"] = "12"
    assert board["n"] == 12
    board["n"] = 3.0
    assert (board["n"], type(board["n"])) == (3, int)
    with pytest.raises(BlackboardError, match="the entry 'n' is of type int: the text 'x'"):
        board["n"] = "x"
    board.declare("text", "std::string")
    with pytest.raises(BlackboardError, match="holds a text, not 4"):
        board["text"] = 4


@pytest.mark.parametrize(
    ("first", "then", "kept"),
    [
        # As the library 4.8.2 does it: tests/btcpp/executor/test_tree_with_others.py.
        (1, 7, 7),
        (1, 2.0, 2),
        (1, 2.5, None),
        (1, "9", 9),
        (1, "x", None),
        (1.0, 7, 7.0),
        (1.0, "x", None),
        (True, "false", False),
        (True, 0, None),
        (1, True, None),
        (1.0, True, 1.0),
        ("3", 2.5, 2.5),
        ("3", "x", "x"),
    ],
)
def test_an_entry_that_a_program_sets_has_a_type(first: Any, then: Any, kept: Any) -> None:
    exact, free = Blackboard(exact=True), Blackboard()
    for board in (exact, free):
        board["n"] = first
    free["n"] = then
    assert free["n"] == (then if kept is None else kept)
    if kept is None:
        with pytest.raises(BlackboardError, match="the entry 'n' is of type"):
            exact["n"] = then
    else:
        exact["n"] = then
        assert (exact["n"], type(exact["n"])) == (kept, type(kept))


def test_a_ports_type_replaces_that_of_a_value() -> None:
    free, exact = Blackboard(), Blackboard(exact=True)
    for board in (free, exact):
        board["n"] = 1
        board.declare("n", "double")
    assert (free.type_of("n"), type(free["n"])) == ("double", float)
    assert (exact.type_of("n"), type(exact["n"])) == ("int", int)
    with pytest.raises(BlackboardError, match="the entry 'n' is of type double"):
        free["n"] = "x"


def test_programs_that_set_entries_are_heard_and_nodes_are_not() -> None:
    board, heard = Blackboard(), []
    inner = Blackboard(board)
    inner.watch(lambda: heard.append(1))
    inner["a"] = 1
    board["a"] = 2
    board.write("a", 3)
    board.put("a", 4)
    assert len(heard) == 2
    with pytest.raises(BlackboardError, match="no blackboard entry 'b'"):
        board["b"]


@given(
    st.booleans(),
    st.dictionaries(st.sampled_from("abc"), st.sampled_from("abc")),
    st.lists(st.tuples(st.booleans(), NAMES, st.integers())),
)
def test_what_is_written_is_read_there_and_where_it_is_remapped(
    autoremap: bool, remapped: dict[str, str], writes: list[tuple[bool, str, int]]
) -> None:
    root = Blackboard()
    inner = Blackboard(root, autoremap)
    inner.remapped.update(remapped)
    for is_inner, name, value in writes:
        board = inner if is_inner else root
        board[name] = value
        assert board[name] == value
        outer = remapped.get(name, name if autoremap and name[0] not in "_" else None)
        if is_inner and name.startswith("@"):
            assert root[name[1:]] == value
        elif is_inner and outer is not None:
            assert root[outer] == value


def test_the_entries_of_a_board_can_be_iterated() -> None:
    board = Blackboard()
    assert board
    assert list(board) == []
    board["b"], board["a"] = 1, "x"
    board.declare("without_value")
    assert list(board) == ["a", "b"]
    assert dict(board) == {"a": "x", "b": 1}
    assert len(board) == 2
