"""Envelopes: what is authentic is opened, whatever was changed, repeated or not allowed is not."""

from __future__ import annotations

from unittest import mock

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership import envelope
from mrbt_mesh.core.membership.envelope import (
    MAX_LIVES,
    MAX_TAGS,
    WINDOW,
    ForgedError,
    Guard,
    LateError,
    RefusedError,
    StaleError,
    parse_envelope,
)
from mrbt_mesh.core.membership.wire import IncompatibleError, MessageKind, WireError
from mrbt_mesh.runtime.member_keys import MemberKeys
from tests.support.keys import keys_of

BEAT, FACT, PULL = MessageKind.HEARTBEAT, MessageKind.FACT, MessageKind.PULL
COMMAND, STATE = MessageKind.COMMAND, MessageKind.STATE
Team = dict[str, MemberKeys]
SMALL = keys_of("A", "B", "C", observer="eye")
LARGE = keys_of(*(f"R{number}" for number in range(MAX_TAGS)), "A", "B", "C")
TEAMS = pytest.mark.parametrize("keys", [SMALL, LARGE], ids=["tags", "signature"])


def guard(keys: Team, name: str, life: int = 5, run: str = "run") -> Guard:
    return Guard(keys[name], run, life)


@TEAMS
def test_what_a_member_says_to_all_is_opened_by_all(keys: Team) -> None:
    message = guard(keys, "A").seal(b"hello")
    for name in sorted(keys.keys() - {"A"}):
        assert guard(keys, name).open(message, BEAT, "A") == ("A", b"hello")


def test_a_small_team_proves_with_tags_and_a_large_one_with_a_signature() -> None:
    assert isinstance(parse_envelope(guard(SMALL, "A").seal(b"x")).proof, dict)
    assert isinstance(parse_envelope(guard(LARGE, "A").seal(b"x")).proof, bytes)
    assert isinstance(parse_envelope(guard(LARGE, "A").seal(b"x", ("B",))).proof, dict)


@TEAMS
@given(data=st.data())
def test_no_changed_byte_gets_through(keys: Team, data: st.DataObject) -> None:
    text = b"a message of some length"
    message = bytearray(guard(keys, "A").seal(text))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(message) - 1))
        message[at] ^= data.draw(st.integers(1, 255))
    try:
        found = guard(keys, "B").open(bytes(message), BEAT, "A")
    except ForgedError:
        return
    # Only a tag for somebody else was changed, or bytes were changed back.
    assert found == ("A", text)


@given(st.binary(max_size=300))
def test_noise_is_refused_and_nothing_else_happens(noise: bytes) -> None:
    with pytest.raises(ForgedError):
        guard(SMALL, "B").open(noise, BEAT, "A")


@TEAMS
def test_a_message_counts_once(keys: Team) -> None:
    receiver, message = guard(keys, "B"), guard(keys, "A").seal(b"x")
    receiver.open(message, BEAT, "A")
    with pytest.raises(ForgedError, match="said before"):
        receiver.open(message, BEAT, "A")


def test_messages_may_overtake_one_another_by_a_window() -> None:
    sender, receiver = guard(SMALL, "A"), guard(SMALL, "B")
    messages = [sender.seal(b"x") for _ in range(WINDOW + 1)]
    receiver.open(messages[-1], BEAT, "A")
    with pytest.raises(LateError, match="late: 256 messages"):
        receiver.open(messages[0], BEAT, "A")
    for message in reversed(messages[1:-1]):
        receiver.open(message, BEAT, "A")
    for message in messages[1:]:
        with pytest.raises(ForgedError, match="said before"):
            receiver.open(message, BEAT, "A")


@given(st.permutations(range(12)), st.lists(st.integers(0, 11)))
def test_in_any_order_each_is_taken_exactly_once(order: list[int], again: list[int]) -> None:
    sender, receiver = guard(SMALL, "A"), guard(SMALL, "B")
    messages = [sender.seal(bytes([number])) for number in range(12)]
    taken = []
    for number in [*order[:6], *again, *order]:
        try:
            taken.append(receiver.open(messages[number], BEAT, "A")[1][0])
        except ForgedError:
            continue
    assert sorted(taken) == list(range(12))


def test_a_life_is_forgotten_when_it_was_silent_for_longest_and_nothing_of_it_counts_again() -> (
    None
):
    receiver = guard(SMALL, "B")
    active, idle = guard(SMALL, "op", 1), guard(SMALL, "op", 2)
    heard = [idle.seal(b"x", ("B",)), active.seal(b"x", ("B",))]
    for message in heard:
        receiver.open(message, PULL)
    for life in range(10, 10 + 3 * MAX_LIVES):
        heard.append(guard(SMALL, "op", life).seal(b"x", ("B",)))
        receiver.open(heard[-1], PULL)
        receiver.open(active.seal(b"still here", ("B",)), PULL)
    with pytest.raises(StaleError, match="a life of op from before 256 others"):
        receiver.open(idle.seal(b"new", ("B",)), PULL)
    for message in heard:
        with pytest.raises((ForgedError, LateError, StaleError)):
            receiver.open(message, PULL)


LIVES = st.integers(1, 2 * MAX_LIVES)


@given(st.lists(st.tuples(LIVES, st.integers(1, 3)), min_size=2, max_size=60), st.data())
def test_no_message_of_any_life_counts_twice(
    said: list[tuple[int, int]], data: st.DataObject
) -> None:
    """Lives begin, go on and end in any order, also with clocks that go back."""
    with mock.patch.object(envelope, "MAX_LIVES", 4):
        receiver, senders = guard(SMALL, "B"), dict[int, Guard]()
        messages = []
        for life, count in said:
            sender = senders.setdefault(life, guard(SMALL, "op", life))
            messages += [sender.seal(b"x", ("B",)) for _ in range(count)]
        taken: set[bytes] = set()
        for message in [*messages, *data.draw(st.permutations(messages))]:
            try:
                receiver.open(message, PULL)
            except (ForgedError, LateError, StaleError):
                continue
            assert message not in taken
            taken.add(message)


@pytest.mark.parametrize("kind", [PULL, COMMAND])
def test_a_sender_that_was_forgotten_goes_on_in_a_later_life(kind: MessageKind) -> None:
    """Also one whose clock is far behind those of the others."""
    robot, another = guard(SMALL, "B", life=7), guard(SMALL, "C", life=7)
    idle = guard(SMALL, "op", life=2)
    for each, name in ((robot, "B"), (another, "C")):
        idle.open(each.seal(b"here"), BEAT, name)
    for life in range(1_000, 1_001 + MAX_LIVES):
        robot.open(guard(SMALL, "op", life).seal(b"x", ("B",)), PULL)

    def sealed(name: str) -> bytes:
        return idle.seal_command(b"x", name) if kind is COMMAND else idle.seal(b"x", (name,))

    with pytest.raises(StaleError) as refused:
        robot.open(sealed("B"), kind)
    with pytest.raises(RefusedError, match="B refuses this: a life of op from before"):
        idle.open(robot.seal(refused.value.content, ("op",)), STATE, "B")
    for _ in range(2):
        assert robot.open(sealed("B"), kind) == ("op", b"x")
    # Nothing has changed for others, who may have been told nothing of the kind.
    assert parse_envelope(sealed("C")).life == 2
    assert another.open(sealed("C"), kind) == ("op", b"x")


def test_a_robot_that_was_forgotten_is_heard_again_by_all_after_one_answer() -> None:
    first, second = guard(SMALL, "B"), guard(SMALL, "C")
    for life in range(1_000, 1_001 + MAX_LIVES):
        for each in (first, second):
            each.open(guard(SMALL, "A", life).seal(b"x"), BEAT, "A")
    robot = guard(SMALL, "A", life=2)  # its clock went back
    with pytest.raises(StaleError):
        first.open(robot.seal(b"x"), BEAT, "A")
    with pytest.raises(StaleError) as refused:
        first.open(robot.seal(b"x", ("B",)), PULL)
    with pytest.raises(RefusedError):
        robot.open(first.seal(refused.value.content, ("A",)), STATE, "B")
    for each in (first, second):
        assert each.open(robot.seal(b"x"), BEAT, "A") == ("A", b"x")


@pytest.mark.parametrize("forgotten", [-1, 0, 1 << 62, 1 << 70, "7", None])
def test_an_insider_cannot_drive_lives_to_their_end(forgotten: object) -> None:
    robot, operator = guard(SMALL, "B"), guard(SMALL, "op", life=2)
    content = StaleError("op", "no", 0).content[: -len(msgpack.packb(0))]
    with pytest.raises(WireError, match=r"refusal is malformed|B refuses this: no"):
        operator.open(robot.seal(content + packed(forgotten), ("op",)), STATE, "B")
    assert parse_envelope(operator.seal(b"x", ("B",))).life == 2


def packed(value: object) -> bytes:
    """As msgpack, which has no larger numbers."""
    try:
        return bytes(msgpack.packb(value))
    except OverflowError:
        return b"\xcf" + bytes(7)


@given(st.binary(max_size=60))
def test_a_refusal_is_read_or_refused(noise: bytes) -> None:
    robot, operator = guard(SMALL, "B"), guard(SMALL, "op", life=2)
    begin = StaleError("op", "no").content[:9]
    with pytest.raises(WireError):
        operator.open(robot.seal(begin + noise, ("op",)), STATE, "B")


def test_another_run_is_told_from_a_forgery() -> None:
    other = guard(SMALL, "A", run="yesterday")
    with pytest.raises(IncompatibleError, match="yesterday"):
        guard(SMALL, "B").open(other.seal(b"x"), BEAT, "A")
    stranger = guard(keys_of("A", "B", team="other"), "A", run="yesterday")
    with pytest.raises(ForgedError, match="signature is wrong"):
        guard(SMALL, "B").open(stranger.seal(b"x"), BEAT, "A")


def test_messages_of_another_run_do_not_push_out_what_is_remembered() -> None:
    receiver, message = guard(SMALL, "B"), guard(SMALL, "A").seal(b"x")
    receiver.open(message, BEAT, "A")
    for life in range(100, 100 + 2 * MAX_LIVES):
        with pytest.raises(IncompatibleError):
            receiver.open(guard(SMALL, "A", life, run="yesterday").seal(b"x"), BEAT, "A")
    with pytest.raises(ForgedError, match="said before"):
        receiver.open(message, BEAT, "A")


@TEAMS
def test_a_second_process_of_a_robot_does_not_deafen_the_first(keys: Team) -> None:
    sender, first, second = guard(keys, "A"), guard(keys, "B", 7), guard(keys, "B", 8)
    sender.open(second.seal(b"here"), BEAT, "B")
    for message in (sender.seal(b"x"), sender.seal(b"x", ("B",))):
        for receiver in (first, second):
            assert receiver.open(message, BEAT, "A") == ("A", b"x")


@TEAMS
def test_nobody_speaks_under_anothers_name(keys: Team) -> None:
    with pytest.raises(ForgedError, match="sent by A under the name of C"):
        guard(keys, "B").open(guard(keys, "A").seal(b"x"), BEAT, "C")


@TEAMS
def test_an_insider_cannot_write_anothers_name_into_the_envelope(keys: Team) -> None:
    forger = Guard(Renamed(keys["A"], "C"), "run", 5)
    for message in (forger.seal(b"x"), forger.seal(b"x", ("B",))):
        with pytest.raises(ForgedError, match="signature is wrong"):
            guard(keys, "B").open(message, BEAT, "C")


class Renamed(MemberKeys):
    """Keys of one member that say they are another's."""

    def __init__(self, keys: MemberKeys, name: str) -> None:
        self.__dict__.update(keys.__dict__)
        self._name = name


def test_an_answer_to_one_is_not_taken_by_another() -> None:
    answer = guard(SMALL, "A").seal(b"x", ("C",))
    with pytest.raises(ForgedError, match="meant for somebody else"):
        guard(SMALL, "B").open(answer, STATE, "A")


@pytest.mark.parametrize(
    ("sender", "kind"),
    [("eye", BEAT), ("eye", FACT), ("eye", COMMAND), ("op", BEAT), ("op", FACT), ("A", COMMAND)],
)
def test_roles_say_no_more_than_they_may(sender: str, kind: MessageKind) -> None:
    with pytest.raises(ForgedError, match="may not say this"):
        guard(SMALL, "B").open(guard(SMALL, sender).seal(b"x", ("B",)), kind)


@pytest.mark.parametrize("sender", ["eye", "op", "A"])
def test_all_members_may_read(sender: str) -> None:
    found = guard(SMALL, "B").open(guard(SMALL, sender).seal(b"x", ("B",)), PULL)
    assert found == (sender, b"x")


def test_a_command_is_obeyed_once_and_only_by_the_life_that_it_is_meant_for() -> None:
    operator, robot = guard(SMALL, "op"), guard(SMALL, "B", life=7)
    with pytest.raises(StaleError, match="meant for an earlier life of B") as refused:
        robot.open(operator.seal_command(b"early", "B"), COMMAND)
    with pytest.raises(RefusedError):
        operator.open(robot.seal(refused.value.content, ("op",)), MessageKind.ANSWER, "B")
    command = operator.seal_command(b"abort", "B")
    with pytest.raises(StaleError):
        guard(SMALL, "B", life=8).open(command, COMMAND)
    assert robot.open(command, COMMAND) == ("op", b"abort")
    with pytest.raises(ForgedError, match="said before"):
        robot.open(command, COMMAND)


def test_a_command_is_for_the_life_that_was_heard_last_also_after_a_clock_went_back() -> None:
    operator, robot = guard(SMALL, "op"), guard(SMALL, "B", life=3)
    operator.open(guard(SMALL, "B", life=7).seal(b"here"), BEAT, "B")
    operator.open(robot.seal(b"here"), BEAT, "B")
    assert robot.open(operator.seal_command(b"x", "B"), COMMAND) == ("op", b"x")


def test_strangers_and_what_is_not_sealed_are_refused() -> None:
    stranger = guard(keys_of("Z", "B"), "Z").seal(b"x")
    with pytest.raises(ForgedError, match="'Z' has no key in this team"):
        guard(SMALL, "B").open(stranger, BEAT, "Z")
    with pytest.raises(ForgedError, match="not signed"):
        guard(SMALL, "B").open(b"\x97" + bytes(7), BEAT, "A")
    with pytest.raises(ForgedError, match="more than"):
        guard(SMALL, "B").open(bytes(5 << 20), BEAT, "A")
