"""A token is gone when nobody holds it: strangers take no robot's down, and cost little."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.runtime.token_holders import (
    CHANGES_AT_ONCE,
    CHANGES_PER_S,
    MAX_HOLDERS,
    MAX_LIVES,
    MAX_ROBOTS,
    OBSERVER,
    QUIET_US,
    UNHEARD,
    Change,
    Holder,
    TokenHolders,
    life_of,
)
from tests.support.keys import keys_of

LIFE, NEXT = Incarnation(1, "n"), Incarnation(2, "n")
HELD, GONE, NOTHING, PASSED_OVER = Change.HELD, Change.GONE, Change.NOTHING, Change.PASSED_OVER


class Tokens:
    """Holders of tokens, with a clock and robots of its own."""

    def __init__(self, **lives: Incarnation) -> None:
        self.now_us = 0
        self.lives = {"A": LIFE} | lives
        self.holders = TokenHolders(self.lives.get, lambda: self.now_us)

    def show(self, session: str, life: Incarnation = LIFE, robot: str = "A") -> Change:
        return self.holders.change(robot, life, by(session), True)

    def drop(self, session: str, life: Incarnation = LIFE, robot: str = "A") -> Change:
        return self.holders.change(robot, life, by(session), False)

    def flood(self, life: Incarnation = LIFE, robot: str = "A", count: int = 500) -> list[Change]:
        """A stranger shows many tokens and drops them."""
        shown = [self.show(f"x{number}", life, robot) for number in range(count)]
        return shown + [self.drop(f"x{number}", life, robot) for number in range(count)]


def by(session: str) -> Holder:
    """`session`, or `session@router`."""
    name, _, router = session.partition("@")
    return Holder(name, router)


def test_a_token_comes_and_goes_with_its_robot() -> None:
    tokens = Tokens()
    assert [tokens.show("a"), tokens.show("a")] == [HELD, NOTHING]
    assert [tokens.drop("a"), tokens.drop("a")] == [GONE, NOTHING]
    assert [tokens.show("a"), tokens.drop("a")] == [HELD, GONE]


def test_a_stranger_s_token_changes_nothing_while_the_robot_holds_its_own() -> None:
    tokens = Tokens()
    tokens.show("a")
    assert [tokens.show("x"), tokens.drop("x")] == [NOTHING, NOTHING]
    assert tokens.drop("a") is GONE


def test_only_the_present_life_is_told() -> None:
    tokens = Tokens()
    tokens.show("a")
    assert [tokens.show("b", NEXT), tokens.drop("b", NEXT)] == [NOTHING, NOTHING]
    tokens.show("b", NEXT)
    tokens.lives["A"] = NEXT  # its first heartbeat
    assert tokens.drop("a") is NOTHING
    assert [tokens.show("x"), tokens.drop("x")] == [NOTHING, NOTHING]
    assert tokens.drop("b", NEXT) is GONE


def test_a_robot_s_new_session_takes_over_its_token() -> None:
    tokens = Tokens()
    assert [tokens.show("a"), tokens.show("a2"), tokens.drop("a")] == [HELD, NOTHING, NOTHING]
    assert tokens.drop("a2") is GONE
    assert tokens.holders.last_session("A", LIFE) == "a2"


def test_a_robot_that_has_found_another_router_shows_that_before_its_first_token_ends() -> None:
    tokens = Tokens()
    assert [tokens.show("a@r1"), tokens.show("a@r2"), tokens.drop("a@r1")] == [HELD, HELD, NOTHING]
    assert tokens.holders.robots_of({"a", "b"}) == {"A"}
    assert tokens.holders.last_session("B", LIFE) == ""
    assert tokens.drop("a@r2") is GONE
    assert tokens.holders.robots_of({"a", "b"}) == frozenset()
    assert tokens.holders.last_session("A", LIFE) == "a"


@pytest.mark.parametrize("life", [LIFE, NEXT])
def test_in_a_flood_a_robot_s_tokens_are_passed_over_and_its_end_is_not_told(
    life: Incarnation,
) -> None:
    tokens = Tokens(B=LIFE)
    tokens.show("a")
    tokens.show("b", robot="B")
    found = tokens.flood(life)
    assert {HELD, GONE}.isdisjoint(found)
    assert found.count(PASSED_OVER) >= len(found) - CHANGES_AT_ONCE - MAX_HOLDERS
    assert tokens.drop("a") is NOTHING, "it may have a newer token, which was passed over"
    assert tokens.drop("b", robot="B") is GONE


def test_after_a_quiet_time_all_tokens_are_listed_again() -> None:
    tokens = Tokens()
    tokens.show("a")
    assert not tokens.holders.must_list_again()
    tokens.flood()
    tokens.now_us += QUIET_US - 1
    assert not tokens.holders.must_list_again()
    tokens.now_us += 1
    assert tokens.holders.must_list_again()
    tokens.holders.clear()
    assert not tokens.holders.must_list_again()
    assert [tokens.show("a"), tokens.drop("a")] == [HELD, GONE]


def test_tokens_of_earlier_lives_make_nothing_doubtful() -> None:
    tokens = Tokens(A=NEXT)
    tokens.show("a", NEXT)
    assert tokens.flood(LIFE).count(PASSED_OVER) > 1_000 - CHANGES_AT_ONCE
    assert tokens.drop("a", NEXT) is GONE


def test_a_robot_has_a_few_changes_a_second() -> None:
    tokens = Tokens()
    tokens.flood()
    tokens.now_us += 1_000_000
    looked_at = [tokens.drop("y") for _ in range(100)]
    assert looked_at.count(NOTHING) == CHANGES_PER_S


def test_what_is_kept_is_bounded() -> None:
    tokens = Tokens(**{f"R{number}": LIFE for number in range(MAX_ROBOTS + 1)})
    for number in range(1, MAX_LIVES + 1):
        assert tokens.show("a", Incarnation(number, "n")) is not PASSED_OVER
    assert tokens.show("a", Incarnation(MAX_LIVES + 1, "n")) is PASSED_OVER
    tokens.drop("a", NEXT)
    assert tokens.show("a", Incarnation(MAX_LIVES + 1, "n")) is NOTHING
    for number in range(MAX_HOLDERS):
        assert tokens.show(f"{number}", robot="R0") is not PASSED_OVER
    assert tokens.show("one more", robot="R0") is PASSED_OVER
    for number in range(1, MAX_ROBOTS):
        tokens.show("a", robot=f"R{number}")
    assert not tokens.holders.knows(f"R{MAX_ROBOTS}")


def test_names_that_no_robot_has_are_not_kept_and_share_their_changes() -> None:
    tokens = Tokens()
    found = [tokens.show("x", robot=f"Z{number}") for number in range(100)]
    assert found.count(NOTHING) == CHANGES_AT_ONCE
    assert not tokens.holders.knows("Z1")
    tokens.now_us = QUIET_US
    assert tokens.holders.must_list_again(), "a key that is new may not be known here yet"


def test_those_who_only_watch_are_no_reason_to_list_again() -> None:
    tokens = Tokens()
    assert tokens.show("w", robot=OBSERVER) is NOTHING
    tokens.now_us = QUIET_US
    assert not tokens.holders.must_list_again()


def test_robots_are_those_that_are_known_and_those_with_keys() -> None:
    keys = keys_of("A", "B")["A"]
    with_keys, without = life_of(dict, keys), life_of(dict, None)
    assert [with_keys(name) for name in ("B", "op", "Z", OBSERVER)] == [UNHEARD, None, None, None]
    assert [without(name) for name in ("B", "Z", OBSERVER)] == [UNHEARD, UNHEARD, None]
