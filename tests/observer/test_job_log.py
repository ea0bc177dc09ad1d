"""What an observer has seen of jobs."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.core.facts.records import Claim, JobEnd, JobState, NoClaim, Outcome, Phase
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry, parse_entry
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.observer import job_log
from mrbt_mesh.observer.job_history import JobHistory
from mrbt_mesh.observer.job_log import JobLog
from mrbt_mesh.observer.run_record import RunRecord
from tests.support.behaviour import mission_of
from tests.support.commands import command, submission

MISSION = mission_of("""
mission: m
ends: never
local_tasks: {look: {sets: [found]}}
blackboard: {found: {values: [red, blue], per: job}, note: {text: 8}}
robot_types: {T: {capabilities: {look: 1}}}
robots: {A: T, B: T}
global_tasks: {look: {needs: {look: {}}}}
jobs:
  once: {tree: look}
  again: {attempts: 3, tree: look}
  inside: {tree: {Sequence: [{RetryUntilSuccessful: {attempts: 3, do: look}}]}}
tree: {Jobs: all}
""")
VERSION = Version(Incarnation(1, "n"), 1)


def activation(kind: str, attempts: str) -> str:
    leaf = next(
        node for node in MISSION.tree.nodes if node.subject == "look" and kind in path(node.index)
    )
    return f"r:{leaf.number}@one:look:{attempts}:0"


def claim(kind: str, attempts: str, phase: Phase, robot: str = "A") -> Entry:
    held = Claim(activation(kind, attempts), "look", "look", phase, 1)
    return make_entry(robot, "claim", VERSION, held)


def path(index: int) -> set[str]:
    """The names of a node and of those above it."""
    nodes, found = MISSION.tree.nodes, set()
    while index > 0:
        found.add(nodes[index].name)
        index = nodes[index].parent
    return found


def seen(*events: tuple[Entry, int], is_older: bool = False) -> JobHistory:
    log = JobLog(MISSION)
    for entry, now_us in events:
        log.fact(entry, now_us, is_older)
    return log.jobs["one"]


END = make_entry(
    "A", "job_end/one", VERSION, JobEnd(JobState.FAILED, "again", (), "me", "", ("A",), 9)
)


def test_times_are_those_of_the_first_fact() -> None:
    events = (
        (submission("one", "again", not_before_us=5, deadline_us=9), 10),
        (claim("again", "0", Phase.CLAIMED), 20),
        (claim("again", "0", Phase.RUNNING), 30),
        (claim("again", "1", Phase.RUNNING), 40),
        (END, 50),
        (command("job_cancelled/one", True), 60),
    )
    found = seen(*events)
    assert (found.submitted_us, found.begun_us, found.ended_us) == (10, 30, 50)
    assert (found.not_before_us, found.deadline_us) == (5, 9)
    older = seen(*events, is_older=True)
    assert (older.submitted_us, older.begun_us, older.ended_us) == (None, None, None)
    assert (older.attempts, older.not_before_us) == (2, 5)


def test_a_unix_time_stays_when_clocks_are_set() -> None:
    found = seen((submission("one", "once"), 10))
    assert found.unix_us("submitted", None) is None
    assert [found.unix_us("submitted", ahead_us) for ahead_us in (1_000, 7_000)] == [1_010, 1_010]
    assert found.unix_us("ended", 1_000) is None


def test_the_times_of_a_job_are_by_one_clock() -> None:
    found = seen((submission("one", "once"), 10), (claim("once", "0", Phase.RUNNING), 20))
    assert found.unix_us("submitted", 1_000) == 1_010
    assert found.unix_us("begun", 985) == 1_020


def test_a_job_is_submitted_before_it_begins_however_facts_come() -> None:
    found = seen((claim("once", "0", Phase.RUNNING), 10), (submission("one", "once"), 20))
    assert (found.submitted_us, found.begun_us) == (10, 10)


@pytest.mark.parametrize(
    ("kind", "attempts", "count"), [("once", "", 1), ("again", "2", 3), ("inside", "2", 1)]
)
def test_attempts_are_those_of_the_whole_tree(kind: str, attempts: str, count: int) -> None:
    assert seen((claim(kind, attempts, Phase.CLAIMED), 1)).attempts == count


def test_results_are_the_entries_of_the_job() -> None:
    def entry(name: str, value: Any) -> tuple[Entry, int]:
        return parse_entry("A", f"condition/{name}", VERSION, [value, 1, 1]), 1

    found = seen(entry("found@job:one", "red"), entry("found@job:other", "blue"))
    assert found.results == {"found": "red"}


def test_those_that_ended_long_ago_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_log, "MOST_ENDED", 1)
    log = JobLog(MISSION)
    log.fact(submission("open", "once"), 1, False)
    log.fact(END, 1, False)
    log.fact(submission("two", "once"), 2, False)
    assert list(log.jobs) == ["open", "one", "two"]
    log.fact(command("job_cancelled/two", True), 3, False)
    assert list(log.jobs) == ["open", "two"]


def test_totals_count_what_is_forgotten_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The team's clocks are 1,000 us ahead. Three jobs: one is done late, one cancelled and done
    all the same, one is open.
    """
    log = JobLog(MISSION, lambda: 1_000)

    def end(name: str, state: JobState, *robots: str) -> Entry:
        return make_entry(
            "A", f"job_end/{name}", VERSION, JobEnd(state, "again", (), "me", "", robots, 9)
        )

    events = (
        (submission("one", "again", not_before_us=1_015, deadline_us=1_045), 10),
        (claim("again", "0", Phase.RUNNING), 30),
        (end("one", JobState.SUCCEEDED, "A", "B"), 50),
        (end("one", JobState.SUCCEEDED, "A", "B"), 55),
        (submission("two", "again"), 60),
        (command("job_cancelled/two", True), 70),
        (end("two", JobState.SUCCEEDED, "B"), 80),
        (submission("three", "again"), 90),
    )
    for entry, now_us in events:
        log.fact(entry, now_us, False)
    whole = log.totals()["again"]
    assert whole.states == {"succeeded": 1, "cancelled": 1, "open": 1}
    assert (whole.delays.count, whole.delays.most_us) == (1, 5)
    assert whole.robots == {"A": 1, "B": 2}
    monkeypatch.setattr(job_log, "MOST_ENDED", 2)
    log.fact(end("three", JobState.FAILED, "B"), 95, False)
    assert list(log.jobs) == ["two", "three"]
    assert log.totals()["again"].states == {"succeeded": 1, "cancelled": 1, "failed": 1}
    assert log.totals()["again"].robots == {"A": 1, "B": 3}


def no_claim(robot: str) -> Entry:
    return make_entry(robot, "claim", VERSION, NoClaim(""))


def watched(*events: tuple[Entry, int], is_catching_up: bool = False) -> RunRecord:
    """A record of robots A and B, of which A dies at 50."""
    record = RunRecord(MISSION, clock_ahead_us=lambda: 1_000)
    for robot in ("A", "B"):
        record.robot_seen(robot, VERSION.incarnation, 0)
    record.is_catching_up = is_catching_up
    for entry, now_us in sorted(events, key=lambda event: event[1]):
        if now_us >= 60:
            record.state("A", State.DEAD, 50, 60)
        record.fact(entry, now_us)
    return record


# A dies at work in the first attempt; B takes the second one over, which is held between two steps.
TAKEN_OVER = (
    (submission("one", "again"), 10),
    (claim("again", "0", Phase.CLAIMED), 20),
    (claim("again", "0", Phase.READY), 30),
    (claim("again", "0", Phase.RUNNING), 35),
    (claim("again", "1", Phase.RUNNING, "B"), 80),
    (command("job_hold/one", "held"), 90),
    (no_claim("B"), 100),
    (command("job_hold/one", "now", 2), 110),
    (command("job_hold/one", "released", 3), 120),
    (claim("again", "1", Phase.RUNNING, "B"), 130),
)


def ended(state: JobState, *robots: str) -> Entry:
    return make_entry("B", "job_end/one", VERSION, JobEnd(state, "again", (), "me", "", robots, 9))


@pytest.mark.parametrize(
    ("ending", "state"),
    [
        (ended(JobState.SUCCEEDED, "B"), "succeeded"),
        (ended(JobState.EXPIRED), "expired"),
        (command("job_cancelled/one", True), "cancelled"),
        (command("aborted", True), "open"),
    ],
)
def test_times_and_robots_are_those_of_all_work_whatever_came_of_it(
    ending: Entry, state: str
) -> None:
    """Time that a job is held is not time that it waits, nor that it is worked on."""
    record = watched(*TAKEN_OVER, (ending, 150))
    totals = record.job_log.totals()["again"]
    assert totals.states == {state: 1}
    assert totals.robots == {"A": 1, "B": 1}
    assert totals.works.all_us == (50 - 30) + (100 - 80) + (150 - 130)
    assert totals.waits.all_us == (30 - 10) + (80 - 50) + (130 - 120)


def test_a_job_that_is_open_has_robots_and_no_times_yet() -> None:
    totals = watched(*TAKEN_OVER).job_log.totals()["again"]
    assert totals.robots == {"A": 1, "B": 1}
    assert (totals.works.count, totals.waits.count) == (0, 0)


def test_robots_that_work_at_the_same_time_count_once() -> None:
    record = watched(
        (submission("one", "once"), 10),
        (claim("once", "", Phase.RUNNING), 20),
        (claim("once", "", Phase.RUNNING, "B"), 30),
        (no_claim("A"), 40),
        (no_claim("B"), 45),
        (ended(JobState.SUCCEEDED, "A", "B"), 47),
    )
    (history,) = record.job_log.jobs.values()
    assert (history.worked_us(47), history.waited_us(47)) == (25, 12)


def test_a_job_waits_from_when_it_is_due_also_if_nobody_ever_works_on_it() -> None:
    """The team's clocks are 1,000 us ahead."""
    record = watched(
        (submission("one", "once", not_before_us=1_015), 10),
        (submission("two", "once", not_before_us=9_000), 10),
        (command("job_cancelled/one", True), 40),
        (command("job_cancelled/two", True), 40),
    )
    log = record.job_log
    assert [log.jobs[name].waited_us(40) for name in ("one", "two")] == [25, 0]
    assert log.totals()["once"].works.count == 0


def test_times_that_nobody_watched_are_not_known() -> None:
    """Neither those of a job that was there before, nor of one of which a part was missed."""
    end = (ended(JobState.SUCCEEDED, "B"), 150)
    totals = watched(*TAKEN_OVER, end, is_catching_up=True).job_log.totals()["again"]
    assert (totals.works.count, totals.waits.count, totals.robots) == (0, 0, {"A": 1, "B": 1})
    missed = watched(TAKEN_OVER[0])
    missed.is_catching_up = True
    outcome = f"outcome/{activation('again', '0')}/look"
    missed.fact(make_entry("B", outcome, VERSION, Outcome(True)), 100)
    missed.is_catching_up = False
    missed.fact(*end)
    (history,) = missed.job_log.jobs.values()
    assert (history.ended_us, history.waited_us(150)) == (150, None)
