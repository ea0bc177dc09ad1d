"""What waits for the event loop is bounded, in number and in bytes."""

from __future__ import annotations

import asyncio

import pytest

from mrbt_mesh.core.agent.inputs import AnswerReceived, Input, MessageReceived, QueryReceived
from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES, MessageKind
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
