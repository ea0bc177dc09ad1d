"""The gate: what a member has sealed passes, of the rest so much in a second, counted by source."""

from __future__ import annotations

import threading
from dataclasses import replace
from unittest import mock

import pytest

from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    InputRefused,
    MessageReceived,
    QueryReceived,
)
from mrbt_mesh.core.agent.sealing import Sealing
from mrbt_mesh.core.membership import envelope
from mrbt_mesh.core.membership.envelope import MAX_TAGS, ForgedError, Guard
from mrbt_mesh.core.membership.wire import MessageKind, WireError
from mrbt_mesh.runtime.flood_gate import (
    AN_ANSWER,
    BYTES_AT_ONCE,
    CHECKS_AT_ONCE,
    CHECKS_PER_S,
    HOLD_S,
    MAX_HELD,
    MAX_REFUSED,
    NO_SOURCE,
    NOBODY,
    TOO_MUCH,
    FloodGate,
)
from tests.support.keys import keys_of

KEYS = keys_of("A", "B")
LARGE = keys_of("A", "B", *(f"R{number}" for number in range(MAX_TAGS)))
BEAT = MessageKind.HEARTBEAT
LIFE = 7


class Desk:
    """A gate with a clock of its own, what came through, and how long threads had to wait."""

    def __init__(self) -> None:
        self.now_us = 0
        self.got: list[tuple[Input, str | None]] = []
        self.held_s: list[float] = []
        self.gate = FloodGate(
            KEYS["B"],
            "run",
            lambda *each: self.got.append(each) is None,
            lambda: self.now_us,
            self.held_s.append,
        )

    def hear(self, source: str, data: bytes) -> bool:
        return self.gate.deliver(MessageReceived(BEAT, source, data), f"beat/{source}")


def test_what_is_sealed_passes_in_the_midst_of_a_flood_under_the_same_name() -> None:
    desk, sender = Desk(), Guard(KEYS["A"], "run", 1)
    mine = [sender.seal(b"x") for _ in range(50)]
    for message in mine:
        for _ in range(100):
            desk.hear("A", b"noise")
        desk.hear("A", message)
    passed = [event.data for event, slot in desk.got if slot == "beat/A"]  # type: ignore[union-attr]
    assert passed == mine
    assert [slot for _, slot in desk.got].count(None) == CHECKS_AT_ONCE
    assert desk.gate.take_refused() == [InputRefused("A", TOO_MUCH, 5_000 - CHECKS_AT_ONCE)]
    assert desk.gate.take_refused() == []


def test_what_comes_again_takes_no_newer_message_s_place() -> None:
    desk, sender = Desk(), Guard(KEYS["A"], "run", 1)
    old = [sender.seal(b"x") for _ in range(10)]
    for message in [*old, *old]:
        desk.hear("A", message)
    assert [slot for _, slot in desk.got] == ["beat/A"] * 10 + [None] * 10
    desk.hear("A", Guard(KEYS["A"], "yesterday", 1).seal(b"x"))
    desk.hear("op", sender.seal(b"x"))
    assert [slot for _, slot in desk.got][20:] == [None, None]


def test_only_what_is_new_and_has_a_good_tag_is_shown_to_come_from_its_sender() -> None:
    desk, message = Desk(), Guard(KEYS["A"], "run", 1).seal(b"x")
    assert desk.hear("A", message)
    assert not desk.hear("A", message)
    assert not desk.hear("B", message)
    assert not desk.hear("A", b"noise")
    assert not desk.hear("A", Guard(LARGE["A"], "run", 1).seal(b"signed for many"))


def test_a_message_is_taken_apart_and_its_tag_checked_once() -> None:
    desk, sealing = Desk(), Sealing(KEYS["B"], "run", LIFE)
    desk.hear("A", Guard(KEYS["A"], "run", 1).seal(b"x"))
    ((event, _),) = desk.got
    assert isinstance(event, MessageReceived)
    with (
        mock.patch.object(envelope, "parse_envelope", side_effect=AssertionError),
        mock.patch.object(Guard, "_check_proof", side_effect=AssertionError),
    ):
        with pytest.raises(ForgedError, match="under the name of"):
            sealing.open(replace(event, source="op"))
        assert sealing.open(event) == MessageReceived(BEAT, "A", b"x")
        with pytest.raises(ForgedError, match="said before"):
            sealing.open(event)


def test_what_the_gate_has_not_checked_is_checked_when_it_is_opened() -> None:
    desk, sealing = Desk(), Sealing(KEYS["B"], "run", LIFE)
    for data in (b"noise", Guard(keys_of("A", "B")["A"], "yesterday", 1).seal(b"x")):
        desk.hear("A", data)
    for event, _ in desk.got:
        assert isinstance(event, MessageReceived)
        assert event.envelope is None
        with pytest.raises(WireError):
            sealing.open(event)


def test_what_is_not_checked_yet_takes_no_message_s_place() -> None:
    desk = Desk()
    desk.hear("A", Guard(LARGE["A"], "run", 1).seal(b"signed for many"))
    assert [slot for _, slot in desk.got] == [None]


def test_each_source_has_a_budget_that_fills_up_again() -> None:
    desk = Desk()
    for source in ("A", "op"):
        for _ in range(CHECKS_AT_ONCE + 10):
            desk.hear(source, b"noise")
    assert len(desk.got) == 2 * CHECKS_AT_ONCE
    desk.now_us = 1_000_000
    for _ in range(CHECKS_AT_ONCE):
        desk.hear("A", b"noise")
    assert len(desk.got) == 2 * CHECKS_AT_ONCE + CHECKS_PER_S
    refused = {each.source: each.count for each in desk.gate.take_refused()}
    assert refused == {"A": 10 + CHECKS_AT_ONCE - CHECKS_PER_S, "op": 10}


def test_questions_and_orders_of_members_pass_in_the_midst_of_a_flood_of_others() -> None:
    desk, asker = Desk(), Guard(KEYS["A"], "run", 1)
    operator, receiver = Guard(KEYS["op"], "run", 1), Guard(KEYS["B"], "run", LIFE)
    operator.open(receiver.seal(b"x"), BEAT, "B")
    pull, command = asker.seal(b"x", ("B",)), operator.seal_command(b"x", "B")
    # For an earlier life: the robot refuses it, and answers that.
    late = Guard(KEYS["op"], "run", 1).seal_command(b"x", "B")
    for _ in range(CHECKS_AT_ONCE + 5):
        desk.gate.deliver(QueryReceived(1, MessageKind.COMMAND, b"noise"), None)
    for kind, data in (
        (MessageKind.PULL, pull),
        (MessageKind.COMMAND, command),
        (MessageKind.COMMAND, late),
    ):
        desk.gate.deliver(QueryReceived(2, kind, data), None)
    passed = [event.data for event, _ in desk.got[CHECKS_AT_ONCE:]]  # type: ignore[union-attr]
    assert passed == [pull, command, late]
    assert desk.gate.take_refused() == [InputRefused("a query", TOO_MUCH, 5)]
    assert receiver.open(command, MessageKind.COMMAND) == ("op", b"x")


def test_a_thread_that_brings_too_much_waits_and_no_other() -> None:
    desk, sender = Desk(), Guard(KEYS["A"], "run", 1)
    for _ in range(CHECKS_AT_ONCE):
        desk.hear("A", b"noise")
    desk.hear("A", sender.seal(b"x"))
    assert desk.held_s == []
    desk.hear("A", b"noise")
    desk.hear("A", sender.seal(b"x"))
    desk.hear("B", b"noise")
    assert desk.held_s == [HOLD_S]


def test_some_threads_never_wait() -> None:
    waiting, go_on = threading.Semaphore(0), threading.Event()

    def hold(_: float) -> None:
        waiting.release()
        go_on.wait()

    gate = FloodGate(KEYS["B"], "run", lambda *_: True, lambda: 0, hold)

    def flood() -> None:
        gate.deliver(MessageReceived(BEAT, "A", b"noise"), None)

    for _ in range(CHECKS_AT_ONCE):
        flood()
    threads = [threading.Thread(target=flood) for _ in range(MAX_HELD)]
    for thread in threads:
        thread.start()
    for _ in threads:
        waiting.acquire()
    flood()  # comes back
    go_on.set()
    for thread in threads:
        thread.join()
    assert gate.take_refused() == [InputRefused("A", TOO_MUCH, MAX_HELD + 1)]


def test_names_that_no_member_has_share_one_budget() -> None:
    desk = Desk()
    for number in range(CHECKS_AT_ONCE + 10):
        desk.hear(f"Z{number}", b"noise")
    assert len(desk.got) == CHECKS_AT_ONCE
    assert desk.gate.take_refused() == [InputRefused(NOBODY, TOO_MUCH, 10)]


def test_all_that_nobody_is_shown_to_have_sealed_shares_so_many_bytes() -> None:
    desk, sender = Desk(), Guard(KEYS["A"], "run", 1)
    large = bytes(BYTES_AT_ONCE // 2)
    for source in ("A", "op", "Z"):
        desk.hear(source, large)
    desk.gate.deliver(AnswerReceived("A", large), None)
    assert desk.gate.deliver(QueryReceived(1, MessageKind.PULL, large), None) is False
    desk.hear("A", sender.seal(large[: 1 << 20]))
    answer = AnswerReceived("A", sender.seal(b"x", ("B",)))
    desk.gate.deliver(answer, None)
    desk.gate.deliver(AnswerReceived("A", None), None)
    assert [slot for _, slot in desk.got[:3]] == [None, None, "beat/A"]
    assert [event for event, _ in desk.got[3:]] == [answer, AnswerReceived("A", None)]
    assert {each.source for each in desk.gate.take_refused()} == {NOBODY, AN_ANSWER, NO_SOURCE}


def test_what_is_refused_unread_is_counted_and_slows_its_link_down() -> None:
    desk = Desk()
    for number in range(2 * MAX_REFUSED):
        desk.gate.deliver(InputRefused(f"A{number}", "more than 1 bytes", 1), None)
    assert desk.got == []
    assert desk.held_s == [HOLD_S] * 2 * MAX_REFUSED
    refused = desk.gate.take_refused()
    assert refused[0] == InputRefused("A0", "more than 1 bytes", 1)
    assert refused[-1] == InputRefused(NOBODY, "more than 1 bytes", MAX_REFUSED)


def test_in_a_team_without_keys_everything_may_be_authentic() -> None:
    got: list[Input] = []

    def deliver(event: Input, _: str | None) -> bool:
        got.append(event)
        return True

    gate = FloodGate(None, "run", deliver)
    events: list[Input] = [
        MessageReceived(BEAT, "A", b"x"),
        QueryReceived(1, MessageKind.COMMAND, b"x"),
    ]
    assert [gate.deliver(event, None) for event in events] == [True, True]
    assert got == events


def test_behind_a_router_nothing_waits_since_all_share_its_link() -> None:
    held_s: list[float] = []
    gate = FloodGate(
        KEYS["B"], "run", lambda *_: True, lambda: 0, held_s.append, is_link_shared=True
    )
    for _ in range(CHECKS_AT_ONCE + 5):
        gate.deliver(MessageReceived(BEAT, "A", b"noise"), None)
    assert gate.take_refused() == [InputRefused("A", TOO_MUCH, 5)]
    assert held_s == []
