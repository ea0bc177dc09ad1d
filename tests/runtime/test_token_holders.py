"""A token is gone when nobody holds it: strangers cannot take a robot's token down."""

from __future__ import annotations

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.runtime.token_holders import MAX_HOLDERS, MAX_LIVES, Holder, TokenHolders

LIFE = Incarnation(1, "n")


def by(session: str, router: str = "") -> Holder:
    return Holder(session, router)


def test_a_token_comes_and_goes_with_its_robot() -> None:
    holders = TokenHolders()
    assert holders.change("A", LIFE, by("a"), True) is True
    assert holders.change("A", LIFE, by("a"), True) is None
    assert holders.change("A", LIFE, by("a"), False) is False
    assert holders.change("A", LIFE, by("a"), False) is None
    assert holders.change("A", LIFE, by("a"), True) is True
    assert holders.change("A", Incarnation(2, "n"), by("a"), True) is True


def test_a_stranger_s_token_changes_nothing_while_the_robot_holds_its_own() -> None:
    holders = TokenHolders()
    holders.change("A", LIFE, by("a"), True)
    for number in range(2 * MAX_HOLDERS):
        assert holders.change("A", LIFE, by(f"x{number}"), True) is not False
    for number in range(2 * MAX_HOLDERS):
        assert holders.change("A", LIFE, by(f"x{number}"), False) is None
    assert holders.change("A", LIFE, by("a"), False) is False


def test_a_robot_s_new_session_takes_over_its_token() -> None:
    holders = TokenHolders()
    holders.change("A", LIFE, by("a"), True)
    assert holders.change("A", LIFE, by("a2"), True) is True
    assert holders.change("A", LIFE, by("a"), False) is None
    assert holders.change("A", LIFE, by("a2"), False) is False
    assert holders.last_session("A", LIFE) == "a2"


def test_a_robot_that_has_found_another_router_shows_that_before_its_first_token_ends() -> None:
    holders = TokenHolders()
    holders.change("A", LIFE, by("a", "r1"), True)
    assert holders.change("A", LIFE, by("a", "r2"), True) is True
    assert holders.change("A", LIFE, by("a", "r1"), False) is None
    assert holders.robots_of({"a", "b"}) == {"A"}
    assert holders.last_session("B", LIFE) == ""
    assert holders.change("A", LIFE, by("a", "r2"), False) is False
    assert holders.robots_of({"a", "b"}) == frozenset()
    assert holders.last_session("A", LIFE) == "a"


def test_what_is_kept_is_bounded_and_ends_with_the_session_that_heard_it() -> None:
    holders = TokenHolders()
    for number in range(MAX_LIVES):
        holders.change("A", Incarnation(number, "n"), by("x"), True)
    assert holders.change("B", LIFE, by("b"), True) is None
    assert holders.change("B", LIFE, by("b"), False) is None
    holders.clear()
    assert holders.change("B", LIFE, by("b"), True) is True
