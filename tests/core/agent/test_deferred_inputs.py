"""What waits while a plan is made: in order, and nothing is lost."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.deferred_inputs import DeferredInputs
from mrbt_mesh.core.membership.wire import MessageKind

BEAT = inputs.MessageReceived(MessageKind.HEARTBEAT, "B", b"beat")
TIMER = inputs.TimerFired()


def fact(number: int) -> inputs.Input:
    return inputs.MessageReceived(MessageKind.FACT, "B", bytes([number]))


def condition(number: int) -> inputs.Input:
    return inputs.ConditionSet(f"c{number}", True)


def test_without_a_plan_in_the_making_everything_is_taken_at_once() -> None:
    meanwhile = DeferredInputs()
    for event in (BEAT, fact(1), condition(1), TIMER, inputs.LeaveRequested()):
        assert meanwhile.due([event], False) == [event]
    assert not meanwhile.waits


def test_beats_are_heard_and_facts_wait() -> None:
    meanwhile = DeferredInputs()
    assert meanwhile.due([BEAT], True) == [BEAT]
    assert meanwhile.due([fact(1)], True) == []
    assert meanwhile.due([TIMER], True) == [TIMER]
    assert meanwhile.waits


def test_facts_of_others_come_together_and_what_the_robot_says_one_by_one() -> None:
    meanwhile = DeferredInputs()
    events = [fact(1), fact(2), condition(1), condition(2), fact(3)]
    for event in events:
        assert meanwhile.due([event], True) == []
    assert meanwhile.due([TIMER], False) == [TIMER, fact(1), fact(2)]
    assert meanwhile.due([TIMER], False) == [TIMER, condition(1)]
    assert meanwhile.due([TIMER], False) == [TIMER, condition(2)]
    assert meanwhile.due([TIMER], False) == [TIMER, fact(3)]
    assert not meanwhile.waits


def test_a_flood_of_facts_is_taken_in_by_portions() -> None:
    meanwhile = DeferredInputs()
    flood = [fact(number % 256) for number in range(2 * inputs.AT_ONCE + 1)]
    for event in flood:
        assert meanwhile.due([event], True) == []
    taken = [meanwhile.due([TIMER], False)[1:] for _ in range(3)]
    assert list(map(len, taken)) == [inputs.AT_ONCE, inputs.AT_ONCE, 1]
    assert [event for batch in taken for event in batch] == flood


def test_the_plan_comes_before_what_has_waited_for_it() -> None:
    meanwhile = DeferredInputs()
    meanwhile.due([fact(1)], True)
    made = inputs.PlanMade(1, None)  # type: ignore[arg-type]
    assert meanwhile.due([made], True) == [made]


@given(st.lists(st.tuples(st.integers(0, 2), st.booleans()), max_size=40))
def test_nothing_is_lost_or_overtaken(steps: list[tuple[int, bool]]) -> None:
    meanwhile = DeferredInputs()
    given_events: list[inputs.Input] = []
    taken: list[inputs.Input] = []
    for number, (kind, busy) in enumerate(steps):
        event = (fact(number), condition(number), BEAT)[kind]
        if kind != 2:
            given_events.append(event)
        taken += [each for each in meanwhile.due([event], busy) if each is not BEAT]
    while meanwhile.waits:
        taken += [each for each in meanwhile.due([TIMER], False) if each is not TIMER]
    assert taken == given_events
