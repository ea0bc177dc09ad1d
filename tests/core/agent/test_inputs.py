"""What has waited comes in order: news together, what is a step of the tree alone."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MessageKind


def beat(robot: str) -> inputs.NetworkInput:
    return inputs.MessageReceived(MessageKind.HEARTBEAT, robot, b"")


TOKEN = inputs.TokenChanged("B", Incarnation(1, "n"), False)
COMMAND = inputs.QueryReceived(1, MessageKind.COMMAND, b"")
FINISHED = inputs.ActionFinished(1, True)
CONDITION = inputs.ConditionSet("c", True)


def test_news_that_waited_are_one_input() -> None:
    events = [beat("A"), TOKEN, beat("B")]
    assert list(inputs.together(events)) == [inputs.InputBatch(tuple(events))]


def test_one_alone_stays_what_it_is() -> None:
    assert list(inputs.together([TOKEN])) == [TOKEN]
    assert list(inputs.together([])) == []


def test_what_the_robot_or_an_operator_says_is_a_step_of_its_own() -> None:
    events = [CONDITION, CONDITION, beat("A"), beat("B"), COMMAND, beat("C"), FINISHED, CONDITION]
    assert list(inputs.together(events)) == [
        CONDITION,
        CONDITION,
        inputs.InputBatch((beat("A"), beat("B"))),
        COMMAND,
        beat("C"),
        FINISHED,
        CONDITION,
    ]


def test_a_robot_says_something_itself_after_so_many() -> None:
    many = [beat(str(number)) for number in range(2 * inputs.AT_ONCE + 1)]
    sizes = [
        len(event.inputs) if isinstance(event, inputs.InputBatch) else 1
        for event in inputs.together(many)
    ]
    assert sizes == [inputs.AT_ONCE, inputs.AT_ONCE, 1]


@given(st.lists(st.sampled_from([beat("A"), TOKEN, COMMAND, FINISHED, CONDITION]), max_size=250))
def test_nothing_is_lost_or_overtaken(events: list[inputs.Input]) -> None:
    found: list[inputs.Input] = []
    for event in inputs.together(events):
        found.extend(event.inputs if isinstance(event, inputs.InputBatch) else [event])
    assert found == events
