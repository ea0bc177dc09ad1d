"""Commands about jobs at one robot: what it refuses, in words for the operator, and answers."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.core.agent.commands_on_disk import MAX_WAITING, AwaitedAnswer
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Reply
from mrbt_mesh.core.agent.job_clock import JobClock
from mrbt_mesh.core.agent.operator_desk import MAX_AHEAD, RESERVED_US, OperatorDesk
from mrbt_mesh.core.agent.operator_messages import CommandStep, operate_body
from mrbt_mesh.core.facts.jobs import hash_of
from mrbt_mesh.core.facts.records import JOB_END, JobArchive, JobEnd, JobState
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, parse_entry
from tests.support.commands import command, submission
from tests.support.keys import keys_of
from tests.support.one_robot import NOW_US, desk

S = 1_000_000
JOB = submission("a", "inspect", "shelf_1", content=7)


def asked(
    found: OperatorDesk, entry: Entry, step: CommandStep = CommandStep.WRITE, now_us: int = 0
) -> Any:
    """The answer to a command; if it is one that waits for the disk, as if that had it."""
    answer = found.take(operate_body(step, entry), now_us)
    return answer.make() if isinstance(answer, AwaitedAnswer) else answer


def answered(context: Context) -> list[int]:
    context.answer_kept()
    return [effect.query for effect in context.take_effects() if isinstance(effect, Reply)]


def wait(found: OperatorDesk, context: Context, query: int, entry: Entry) -> None:
    answer = found.take(operate_body(CommandStep.WRITE, entry), 0)
    assert isinstance(answer, AwaitedAnswer)
    context.commands_on_disk.wait(query, answer)


def test_a_command_is_answered_once_the_disk_has_it() -> None:
    found, context = desk()
    wait(found, context, 0, JOB)
    wait(found, context, 1, JOB)
    assert answered(context) == []
    context.durability.note_synced(context.durability.take_number())
    assert answered(context) == [0, 1]
    wait(found, context, 2, command("job_hold/a", "held", 2))
    assert answered(context) == []
    context.durability.note_synced(context.durability.take_number())
    assert answered(context) == [2]


def test_the_oldest_of_too_many_queries_are_forgotten() -> None:
    found, context = desk()
    for query in range(MAX_WAITING + 1):
        wait(found, context, query, JOB)
    context.durability.note_synced(context.durability.take_number())
    assert answered(context) == list(range(1, MAX_WAITING + 1))


def test_the_same_request_again_is_the_same_job() -> None:
    found, context = desk()
    assert asked(found, JOB)["state"]["state"] == "open"
    again = submission("a", "inspect", "shelf_1", deadline_us=2_000 * S, content=7, stamp=9)
    assert asked(found, again)["state"]["priority"] == 0
    (job,) = (entry for entry in context.facts.map if entry.parts[0] == "job")
    assert job == JOB
    assert asked(found, command("job_priority/a", 7, 2))["state"]["priority"] == 7
    assert asked(found, command("job_hold/a", "held", 2))["state"]["state"] == "held"
    assert asked(found, command("job_cancelled/a", True, 3))["state"]["state"] == "cancelled"
    assert asked(found, command("job_cancelled/a", True, 4))["state"]["state"] == "cancelled"
    assert asked(found, command("job_hold/a", "released", 5))["cause"] == "ended"
    assert asked(found, JOB)["state"]["state"] == "cancelled"


def test_a_field_is_what_the_newest_command_says_whenever_it_arrives() -> None:
    found, _ = desk()
    asked(found, JOB)
    release, hold = command("job_hold/a", "released", 6), command("job_hold/a", "held", 5)
    assert asked(found, release)["taken"]
    late = asked(found, hold)
    assert (late["taken"], late["kept"], late["stamp"]) == (False, False, 6)
    assert late["state"]["state"] == "open"
    assert asked(found, command("job_priority/a", 4, 5))["taken"], "another field"
    assert asked(found, command("job_hold/a", "now", 7))["state"]["state"] == "held"


def test_a_stamp_that_is_far_ahead_is_refused() -> None:
    found, context = desk()
    far = submission("a", "inspect", "shelf_1", stamp=MAX_AHEAD + 1)
    assert "far ahead of all that D1 has seen" in asked(found, far)["refused"]
    assert context.facts.max_stamp == 0


OTHERS = [
    submission("a", "inspect", "shelf_2", content=8, stamp=2),
    submission("a", "inspect", "shelf_1", priority=3, content=8, stamp=2),
    submission("a", "inspect", "shelf_1", deadline_us=2_000 * S, content=8, stamp=2),
]


@pytest.mark.parametrize("other", OTHERS, ids=["arguments", "priority", "deadline"])
@pytest.mark.parametrize("when", ["open", "cancelled", "ended", "archived", "reserved"])
def test_an_id_is_of_one_job_for_good(other: Entry, when: str) -> None:
    found, context = desk()
    if when == "reserved":
        assert asked(found, JOB, CommandStep.CHECK)["taken"]
        assert asked(found, JOB, CommandStep.CHECK)["taken"], "by the same request again"
        for step in (CommandStep.CHECK, CommandStep.WRITE):
            assert asked(found, other, step)["cause"] == "contended"
        asked(found, other, CommandStep.GIVE_UP)
        assert asked(found, other, CommandStep.WRITE)["cause"] == "contended", "it is not its own"
        assert asked(found, other, CommandStep.CHECK, RESERVED_US)["taken"]
        return
    asked(found, JOB)
    if when == "cancelled":
        asked(found, command("job_cancelled/a", True, 3))
    if when in ("ended", "archived"):
        end = JobEnd(JobState.SUCCEEDED, "inspect", ("shelf_1",), "me", "", ("D1",), 4, 7)
        name, life = f"{JOB_END}/a", Version(Incarnation(1, "x"), 1)
        ends = [parse_entry(robot, name, life, end.to_value()) for robot in ("D1", "D2")]
        context.facts.map.merge(ends)
    if when == "archived":
        context.write([("job_archive/1", JobArchive((hash_of("a"),), (7,)))], 0)
    context.facts.prune()
    refused = asked(found, other)
    assert refused["cause"] == "conflict"
    said = "ended long ago" if when == "archived" else "a: inspect(shelf_1)"
    assert said in refused["refused"]
    state = {"open": "open", "cancelled": "cancelled", "ended": "succeeded", "archived": "ended"}
    assert asked(found, JOB)["state"]["state"] == state[when], "the same request is a success"


def test_a_cancellation_is_taken_also_by_robots_that_have_heard_of_the_end_first() -> None:
    found, context = desk()
    asked(found, JOB)
    end = JobEnd(JobState.CANCELLED, "inspect", ("shelf_1",), "me", "", (), 4, 7)
    context.write([(f"{JOB_END}/a", end)], 0)
    assert asked(found, command("job_cancelled/a", True, 3))["state"]["state"] == "cancelled"
    assert asked(found, command("job_hold/a", "held", 5))["cause"] == "ended"


def test_a_robot_that_has_not_read_its_clock_takes_none_yet() -> None:
    answer = asked(desk(clock_us=None)[0], JOB)
    assert answer["refused"] == "D1 has not read its clock yet"
    assert answer["cause"] == "not_ready"


@pytest.mark.parametrize(("signer", "is_taken"), [("op", True), ("D1", False), ("eye", False)])
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("job/a", ["inspect", ["shelf_1"], 3, 0, 0, 0]),
        ("paused", "pause"),
        ("aborted", True),
        ("borrowed/D1", "at_once"),
    ],
)
def test_in_a_team_with_keys_an_operator_signs_every_command(
    name: str, value: Any, signer: str, is_taken: bool
) -> None:
    keys = keys_of("D1", observer="eye")
    found, context = desk(keys["D1"])
    answer = asked(found, command(name, value, keys=keys[signer], run="r"))
    if is_taken:
        assert answer["taken"]
    else:
        assert answer["refused"] == "no operator of this team has signed it"
        assert len(context.facts.map) == 0


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (submission("b", "paint"), "no jobs of type 'paint'"),
        (submission("b", "inspect"), "inspect takes 1 argument (where)"),
        (submission("b", "inspect", "moon"), "where is one of dock_1,"),
        (submission("a b", "inspect", "shelf_1"), "'a b' names no job"),
        (submission("b", "inspect", "shelf_1", not_before_us=4 * 10**13), "a year from now"),
        (submission("b", "inspect", "shelf_1", deadline_us=999 * S), "has passed, by the team's"),
        (
            submission("b", "inspect", "shelf_1", deadline_us=1_001 * S, not_before_us=1_002 * S),
            "is before the time at which",
        ),
        (command("job_hold/b", "held"), "no job 'b' is known here"),
        (command("job_cancelled/b", True), "no job 'b' is known here"),
        (command("job_priority/b", 1), "no job 'b' is known here"),
        (command("borrowed/R9", "at_once"), "the team has no robot R9"),
        (command("borrowed/D1", "returned"), "D1 is not borrowed"),
        (command("mission/1", ["", False, False]), "a revision that cannot be read"),
        (command("mission_withdrawn/1", True), "revision '1' is not proposed; 0 is in force"),
    ],
    ids=lambda value: value.name if isinstance(value, Entry) else "",
)
def test_a_wrong_command_is_refused_with_the_reason_and_writes_nothing(
    entry: Entry, message: str
) -> None:
    found, context = desk()
    asked(found, JOB)
    before = len(context.facts.map)
    assert message in asked(found, entry)["refused"]
    assert len(context.facts.map) == before


BODY = operate_body(CommandStep.WRITE, command("job_hold/a", "held", 2))
WRONG = [(0, "paint"), (1, "job_hold"), (1, 7), (2, -1), (2, "2"), (3, "x" * 33), (4, ["held"])]
WRONG += [(4, ["x", "op", "", ""]), (4, ["held", ["o"], "", ""]), (4, ["held", "op", 1, ""])]


@pytest.mark.parametrize(("place", "value"), WRONG)
def test_a_malformed_command_is_refused(place: int, value: Any) -> None:
    found, _ = desk()
    asked(found, JOB)
    body = [*BODY[:place], value, *BODY[place + 1 :]]
    assert "malformed command" in str(found.take(body, 0))
    assert "malformed command" in str(found.take(body[:3], 0))
    assert "malformed command" in str(found.take({}, 0))


def test_a_job_that_comes_after_a_revocation_is_taken() -> None:
    """Facts are read anew then."""
    found, context = desk()
    context.facts.set_revoked(frozenset({"D2"}))
    assert asked(found, JOB)["state"]["state"] == "open"
    assert asked(found, JOB)["state"]["state"] == "open"


def test_a_job_that_comes_after_a_revocation_expires() -> None:
    found, context = desk()
    assert context.wall_clock is not None
    clock = JobClock(context.facts, context.wall_clock)
    context.wall_clock.compare(60 * S)
    context.facts.set_revoked(frozenset({"D2"}))
    asked(found, submission("a", "inspect", "shelf_1", deadline_us=NOW_US + S))
    assert [name for name, _ in clock.passed(2 * S)] == ["job_end/a"]


@pytest.mark.parametrize(
    ("sent", "difference"),
    [
        (
            submission("a", "inspect", "shelf_2", priority=7, content=8),
            "arguments (there shelf_1, sent shelf_2), priority (there 0, sent 7)",
        ),
        (
            submission("a", "deliver", "shelf_1", "dock_1", "2", content=8),
            "type (there inspect, sent deliver), arguments (there shelf_1, sent shelf_1, dock_1, 2",
        ),
        (
            submission("a", "inspect", "shelf_1", not_before_us=1_777_888_999 * S, content=8),
            "not_before (there none, sent 2026-05-04 10:03:19 UTC)",
        ),
        (
            submission("a", "inspect", "shelf_1", deadline_us=1_777_888_999 * S, content=8),
            "deadline (there none, sent 2026-05-04 10:03:19 UTC)",
        ),
        (submission("a", "inspect", "shelf_1", content=8), "its times, as they were asked for"),
    ],
)
def test_another_job_of_an_id_is_refused_with_the_fields_that_differ(
    sent: Entry, difference: str
) -> None:
    found, _ = desk()
    asked(found, JOB)
    refusal = asked(found, sent)["refused"]
    assert refusal.startswith("there is another job of this id, a: inspect(shelf_1), priority 0;")
    assert f"; it differs in {difference}" in refusal
