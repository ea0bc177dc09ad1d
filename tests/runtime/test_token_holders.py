"""A token is gone when nobody holds it: strangers cannot take a robot's token down."""

from __future__ import annotations

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.runtime.token_holders import MAX_HOLDERS, MAX_LIVES, TokenHolders

LIFE = Incarnation(1, "n")


def test_a_token_comes_and_goes_with_its_robot() -> None:
    holders = TokenHolders()
    assert holders.change("A", LIFE, "a", True) is True
    assert holders.change("A", LIFE, "a", True) is None
    assert holders.change("A", LIFE, "a", False) is False
    assert holders.change("A", LIFE, "a", False) is None
    assert holders.change("A", LIFE, "a", True) is True
    assert holders.change("A", Incarnation(2, "n"), "a", True) is True


def test_a_stranger_s_token_changes_nothing_while_the_robot_holds_its_own() -> None:
    holders = TokenHolders()
    holders.change("A", LIFE, "a", True)
    for number in range(2 * MAX_HOLDERS):
        assert holders.change("A", LIFE, f"x{number}", True) is None
    for number in range(2 * MAX_HOLDERS):
        assert holders.change("A", LIFE, f"x{number}", False) is None
    assert holders.change("A", LIFE, "a", False) is False


def test_a_robot_s_new_session_takes_over_its_token() -> None:
    holders = TokenHolders()
    holders.change("A", LIFE, "a", True)
    assert holders.change("A", LIFE, "a2", True) is None
    assert holders.change("A", LIFE, "a", False) is None
    assert holders.change("A", LIFE, "a2", False) is False


def test_what_is_kept_is_bounded_and_ends_with_the_session_that_heard_it() -> None:
    holders = TokenHolders()
    for number in range(MAX_LIVES):
        holders.change("A", Incarnation(number, "n"), "x", True)
    assert holders.change("B", LIFE, "b", True) is None
    assert holders.change("B", LIFE, "b", False) is None
    holders.clear()
    assert holders.change("B", LIFE, "b", True) is True
