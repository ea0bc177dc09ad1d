"""What an observer has seen of jobs."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.core.facts.records import Claim, JobEnd, JobState, Phase
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry, parse_entry
from mrbt_mesh.core.observer import job_log
from mrbt_mesh.core.observer.job_history import JobHistory
from mrbt_mesh.core.observer.job_log import JobLog
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


def claim(kind: str, attempts: str, phase: Phase) -> Entry:
    leaf = next(
        node for node in MISSION.tree.nodes if node.subject == "look" and kind in path(node.index)
    )
    name = f"r:{leaf.number}@one:look:{attempts}:0"
    return make_entry("A", "claim", VERSION, Claim(name, "look", "look", phase, 1))


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
    assert (whole.waits.count, whole.waits.all_us) == (1, 15), "from when it may begin"
    assert (whole.works.all_us, whole.delays.count, whole.delays.most_us) == (20, 1, 5)
    assert whole.robots == {"A": 1, "B": 2}
    monkeypatch.setattr(job_log, "MOST_ENDED", 2)
    log.fact(end("three", JobState.FAILED, "B"), 95, False)
    assert list(log.jobs) == ["two", "three"]
    assert log.totals()["again"].states == {"succeeded": 1, "cancelled": 1, "failed": 1}
    assert log.totals()["again"].robots == {"A": 1, "B": 3}
