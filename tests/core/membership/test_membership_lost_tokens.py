"""Which lost tokens are signs of death."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.peer import State
from tests.support.membership_view import View

LIFE = Incarnation(1, "n")
ROUTER = "a1b2"


def lost() -> View:
    """A's token is gone, and its router has been asked."""
    view = View("A", "B")
    assert view.members.receive_token("A", LIFE, False, ROUTER)
    return view


def is_loss(view: View, robot: str, life: Incarnation, is_linked: bool | None) -> bool:
    """Whether the router's answer has made a robot whose token was held lose it."""
    before = view.members.suspicion_changes
    view.members.router_answered(robot, life, is_linked)
    return view.members.suspicion_changes > before and view.members.peers[robot].is_token_lost


def test_a_robot_with_links_of_its_own_has_no_router_to_ask() -> None:
    view = View("A", "B")
    assert not view.members.receive_token("A", LIFE, False, "")
    assert view.at(1)["A"] is State.SUSPECT


def test_a_token_that_is_there_needs_no_answer() -> None:
    assert not View("A").members.receive_token("A", LIFE, True, ROUTER)


@pytest.mark.parametrize(("is_linked", "is_lost"), [(False, True), (True, False), (None, False)])
def test_only_a_living_router_without_a_link_to_it_confirms(
    is_linked: bool | None, is_lost: bool
) -> None:
    assert is_loss(lost(), "A", LIFE, is_linked) is is_lost


def test_one_answer_counts_and_that_to_the_present_question() -> None:
    tokens = lost()
    assert not is_loss(tokens, "B", LIFE, False)
    assert not is_loss(tokens, "A", Incarnation(2, "n2"), False)
    assert is_loss(tokens, "A", LIFE, False)
    assert not is_loss(tokens, "A", LIFE, False)


def test_who_is_heard_or_shows_a_token_meanwhile_is_not_dead() -> None:
    tokens = lost()
    tokens.hear("A")
    assert not is_loss(tokens, "A", LIFE, False)
    tokens = lost()
    tokens.members.receive_token("A", LIFE, True, ROUTER)
    assert not is_loss(tokens, "A", LIFE, False)


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
    tokens = View("A", "B")
    for at, event in enumerate(events):
        if event[0] == "token":
            asked = tokens.members.receive_token("A", LIFE, bool(event[1]), str(event[2]))
            assert asked == (event == ("token", False, ROUTER))
        elif event[0] == "heard":
            tokens.hear("A")
        else:
            found = is_loss(tokens, "A", LIFE, event[1])  # type: ignore[arg-type]
            before = events[at - 1] if at else None
            assert found == (event[1] is False and before == ("token", False, ROUTER))
