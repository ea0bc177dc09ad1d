"""What waits for the event loop is bounded, in number and in bytes."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    MessageReceived,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import (
    MAX_MESSAGE_BYTES,
    Header,
    Heartbeat,
    MessageKind,
    RequestAnswer,
    SelfReport,
    Suspicion,
    write_heartbeat,
)
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.inbox import MAX_WAITING, MAX_WAITING_BYTES, Inbox

BEAT, PULL = MessageKind.HEARTBEAT, MessageKind.PULL
LARGE = bytes(MAX_MESSAGE_BYTES)
FIT = MAX_WAITING_BYTES // MAX_MESSAGE_BYTES


@pytest.fixture
def inbox() -> Inbox:
    loop = asyncio.new_event_loop()
    loop.close()  # which ends nothing: it is woken up in vain
    return Inbox(loop, lambda: None)


@pytest.mark.parametrize(
    "event",
    [MessageReceived(BEAT, "A", LARGE), QueryReceived(1, PULL, LARGE), AnswerReceived("A", LARGE)],
)
def test_the_oldest_of_too_many_bytes_is_dropped(inbox: Inbox, event: Input) -> None:
    for _ in range(2 * FIT):
        inbox.put(event)
    assert (len(inbox.take()), inbox.dropped) == (FIT, FIT)
    inbox.put(event)
    assert (len(inbox.take()), inbox.dropped) == (1, FIT)


def test_what_is_replaced_takes_no_place(inbox: Inbox) -> None:
    for number in range(2 * FIT):
        inbox.put(MessageReceived(BEAT, f"{number}", LARGE), "beat/A")
    assert [event.source for event in inbox.take()] == [f"{2 * FIT - 1}"]  # type: ignore[union-attr]
    assert inbox.dropped == 0


def test_the_oldest_of_too_many_is_dropped(inbox: Inbox) -> None:
    for number in range(MAX_WAITING + 1):
        inbox.put(AnswerReceived(f"{number}", None))
    waiting = inbox.take()
    assert (len(waiting), inbox.dropped) == (MAX_WAITING, 1)
    assert waiting[0] == AnswerReceived("1", None)


# -- heartbeats without news ------------------------------------------------------------------

FIRST = Incarnation(1, "n")
BEAT_7 = Heartbeat(
    SelfReport(FIRST, 7, b"plan0000", True, 1), False, b"facts000", (1, 1, 1, 1), 0, (), {}
)
BEAT_8 = replace(BEAT_7, report=replace(BEAT_7.report, number=8))
SUSPECT = Suspicion("C", FIRST, is_token_lost=True, is_dead=False, is_probe=False)


def received(beat: Heartbeat) -> MessageReceived:
    header = Header("0" * 16, "m", "r", "A")
    return MessageReceived(BEAT, "A", write_heartbeat(beat, header))


@pytest.fixture
def quiet() -> Inbox:
    loop = asyncio.new_event_loop()
    loop.close()
    inbox = Inbox(loop, lambda: None, are_beats_quiet=True)
    inbox.put(received(BEAT_7), "beat/A")
    assert inbox.take() == [received(BEAT_7)]  # the first one is news
    return inbox


@pytest.mark.parametrize(
    "beat",
    [
        BEAT_8,
        replace(BEAT_8, progress=30),
        replace(BEAT_8, relays={"B": SelfReport(FIRST, 9, b"plan0000", True, 1)}),
    ],
    ids=["only its number", "progress", "a relay"],
)
def test_a_heartbeat_without_news_waits_with_its_time(quiet: Inbox, beat: Heartbeat) -> None:
    quiet.put(received(BEAT_8), "beat/A")
    quiet.put(received(beat), "beat/A")
    assert quiet.take() == []
    (event,) = quiet.take_quiet(0)
    assert event == received(beat)
    assert event.arrived_us
    assert quiet.take_quiet(0) == []


@pytest.mark.parametrize(
    "beat",
    [
        replace(BEAT_8, report=replace(BEAT_8.report, plan_digest=b"plan0001")),
        replace(BEAT_8, report=replace(BEAT_8.report, result=2)),
        replace(BEAT_8, report=replace(BEAT_8.report, incarnation=Incarnation(2, "n"))),
        replace(BEAT_8, report=replace(BEAT_8.report, has_joined=False)),
        replace(BEAT_8, is_leaving=True),
        replace(BEAT_8, fact_digest=b"facts001"),
        replace(BEAT_8, members_digest=b"members1"),
        replace(BEAT_8, suspicions=(SUSPECT,)),
        replace(BEAT_8, request=("a", "b")),
        replace(BEAT_8, answers=(RequestAnswer("b", "C", 3),)),
    ],
)
def test_news_do_not_wait_and_take_the_place_of_what_does(quiet: Inbox, beat: Heartbeat) -> None:
    quiet.put(received(BEAT_8), "beat/A")
    quiet.put(received(beat), "beat/A")
    assert quiet.take() == [received(beat)]
    assert quiet.take_quiet(0) == []


def test_the_same_suspicions_are_no_news_unless_they_ask_for_some(quiet: Inbox) -> None:
    suspecting = received(replace(BEAT_8, suspicions=(SUSPECT,)))
    quiet.put(suspecting, "beat/A")
    assert quiet.take() == [suspecting]
    quiet.put(suspecting, "beat/A")
    late_us = boottime_us() + 1
    (event,) = quiet.take_quiet(late_us)
    assert (event, event.arrived_us) == (suspecting, late_us)
    asking = received(replace(BEAT_8, suspicions=(replace(SUSPECT, is_probe=True),)))
    for _ in range(2):
        quiet.put(asking, "beat/A")
        assert quiet.take() == [asking]


def test_a_heartbeat_that_came_before_its_robots_token_ended_is_taken_before(quiet: Inbox) -> None:
    quiet.put(received(BEAT_8), "beat/A")
    lost = TokenChanged("A", FIRST, False, "r1")
    quiet.put(lost, "token/A/1")
    assert quiet.take() == [received(BEAT_8), lost]
    assert quiet.take_quiet(0) == []


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x90", bytes(5_000)])
def test_what_is_no_heartbeat_does_not_wait(quiet: Inbox, data: bytes) -> None:
    for _ in range(2):
        quiet.put(MessageReceived(BEAT, "A", data), "beat/A")
        assert quiet.take() == [MessageReceived(BEAT, "A", data)]


def test_a_repetition_stays_with_the_news_that_waits(quiet: Inbox) -> None:
    news = replace(BEAT_8, fact_digest=b"facts001")
    quiet.put(received(news), "beat/A")
    quiet.put(received(news), "beat/A")
    assert quiet.take() == [received(news)]
    quiet.are_beats_quiet = False
    quiet.put(received(news), "beat/A")
    assert quiet.take() == [received(news)]
