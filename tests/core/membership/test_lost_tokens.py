"""Which lost tokens are signs of death."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.lost_tokens import LostTokens

LIFE = Incarnation(1, "n1")
ROUTER = "a1b2"


def lost() -> LostTokens:
    """A's token is gone, and its router has been asked."""
    tokens = LostTokens()
    assert tokens.must_ask("A", LIFE, False, ROUTER)
    return tokens


def test_a_robot_with_links_of_its_own_has_no_router_to_ask() -> None:
    assert not LostTokens().must_ask("A", LIFE, False, "")


def test_a_token_that_is_there_needs_no_answer() -> None:
    assert not LostTokens().must_ask("A", LIFE, True, ROUTER)


@pytest.mark.parametrize(("is_linked", "is_loss"), [(False, True), (True, False), (None, False)])
def test_only_a_living_router_without_a_link_to_it_confirms(
    is_linked: bool | None, is_loss: bool
) -> None:
    assert lost().is_loss("A", LIFE, is_linked) is is_loss


def test_one_answer_counts_and_that_to_the_present_question() -> None:
    tokens = lost()
    assert not tokens.is_loss("B", LIFE, False)
    assert not tokens.is_loss("A", Incarnation(2, "n2"), False)
    assert tokens.is_loss("A", LIFE, False)
    assert not tokens.is_loss("A", LIFE, False)


def test_who_is_heard_or_shows_a_token_meanwhile_is_not_dead() -> None:
    tokens = lost()
    tokens.heard("A")
    assert not tokens.is_loss("A", LIFE, False)
    tokens = lost()
    tokens.must_ask("A", LIFE, True, ROUTER)
    assert not tokens.is_loss("A", LIFE, False)


EVENTS = st.one_of(
    st.tuples(st.just("token"), st.booleans(), st.sampled_from(["", ROUTER])),
    st.tuples(st.just("heard")),
    st.tuples(st.just("answer"), st.sampled_from([True, False, None])),
)


@given(st.lists(EVENTS, max_size=12))
def test_a_loss_is_confirmed_by_the_last_word_of_a_router_after_the_last_sign_of_life(
    events: list[tuple[object, ...]],
) -> None:
    """Against a definition by the whole history: nothing but the answer came after the loss."""
    tokens = LostTokens()
    for at, event in enumerate(events):
        if event[0] == "token":
            asked = tokens.must_ask("A", LIFE, bool(event[1]), str(event[2]))
            assert asked == (event == ("token", False, ROUTER))
        elif event[0] == "heard":
            tokens.heard("A")
        else:
            found = tokens.is_loss("A", LIFE, event[1])  # type: ignore[arg-type]
            before = events[at - 1] if at else None
            assert found == (event[1] is False and before == ("token", False, ROUTER))
