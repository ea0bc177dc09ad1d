"""The record of a run, told event by event."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.facts.records import (
    CLAIM,
    CONDITION,
    MEMBER,
    Claim,
    ConditionValue,
    Member,
    Phase,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.observer.episodes import DeathTimes, after_text
from mrbt_mesh.observer.run_record import RunRecord
from tests.support.build import action, make_mission, sequence

FIRST, SECOND = Incarnation(1, "n"), Incarnation(2, "m")
S = 1_000_000


@pytest.fixture
def record() -> RunRecord:
    return RunRecord(make_mission(action("weld")))


def member(robot: str, incarnation: Incarnation = FIRST) -> Entry:
    value = Member("A", {"weld": 1}, {}, False, "", "", 7).to_value()
    return parse_entry(robot, MEMBER, Version(incarnation, 1), value)


def test_a_robot_that_dies_before_it_joined_is_no_fault(record: RunRecord) -> None:
    """Its description is heard before its first beat that says it has joined."""
    record.fact(member("A"), 0)
    record.state("A", State.DEAD, 0, S)
    assert record.major == []
    record.state("A", State.ALIVE, S, S)
    record.robot_seen("A", SECOND, 2 * S)
    assert record.robots["A"]["state"] is State.ALIVE


@pytest.mark.parametrize("is_missed_before", [False, True])
def test_the_earliest_end_of_a_process_is_the_time_of_death(
    record: RunRecord, is_missed_before: bool
) -> None:
    """A fault that kills it knows the time; its launcher notices the end later."""
    record.robot_seen("A", FIRST, 0)
    if is_missed_before:
        record.state("A", State.DEAD, S, S)
        assert record.major[0].at_us == S, "the last heartbeat"
    record.exited("A", 2 * S)
    record.exited("A", 2 * S + 30_000)
    record.declared_dead("A", FIRST, 2 * S + 20_000)
    (fault,) = record.major
    assert (fault.at_us, fault.detected_us) == (2 * S, 2 * S + 20_000)
    record.exited("A", 2 * S + 40_000)
    assert fault.at_us == 2 * S


@pytest.mark.parametrize(("at_us", "is_older"), [(2 * S, False), (9 * S, False), (None, True)])
def test_when_a_robot_died_unseen_is_known_from_its_last_record_alone(
    record: RunRecord, at_us: int | None, is_older: bool
) -> None:
    record.robot_seen("A", FIRST, 0)
    record.died_unseen("A", 5 * S, at_us)
    (fault,) = record.major
    assert (fault.at_us, fault.is_older) == (min(at_us or 5 * S, 5 * S), is_older)


def test_the_end_of_a_life_says_nothing_of_the_next_one(record: RunRecord) -> None:
    record.robot_seen("A", FIRST, 0)
    record.state("A", State.LEFT, S, S)
    record.exited("A", S)
    record.robot_seen("A", SECOND, 5 * S)
    record.declared_dead("A", SECOND, 9 * S)
    (fault,) = record.major
    assert fault.at_us == 9 * S


@pytest.mark.parametrize("is_exit_known", [True, False])
def test_a_replacement_that_is_heard_of_before_the_death_took_over_all_the_same(
    record: RunRecord, is_exit_known: bool
) -> None:
    """The robots knew first: their claims may overtake the word of the death."""

    def running(robot: str, at_us: int) -> None:
        value = Claim("r:0:weld::0", "weld", "weld", Phase.RUNNING, 1).to_value()
        record.fact(parse_entry(robot, CLAIM, Version(FIRST, at_us), value), at_us)

    for robot in ("A", "B", "C"):
        record.robot_seen(robot, FIRST, 0)
    running("C", S)
    running("A", 2 * S)
    if is_exit_known:
        record.exited("A", 3 * S)
    running("B", 3 * S + 20_000)
    record.declared_dead("A", FIRST, 3 * S + 30_000)
    # Its last heartbeat was earlier.
    record.state("A", State.DEAD, 3 * S, 3 * S + 40_000)
    (fault,) = record.major
    assert (fault.replacement, fault.reassigned_us) == ("B", 3 * S + 20_000)
    assert fault.detected_us == fault.reassigned_us, "who takes over knows of the death"


def test_a_replacement_is_found_once_it_is_known_that_the_death_was_earlier() -> None:
    """The end of a process is noticed late where the computer is busy."""
    record = RunRecord(make_mission(action("weld")))
    value = Claim("r:0:weld::0", "weld", "weld", Phase.RUNNING, 1).to_value()
    for robot, at_us in (("A", S), ("B", 3 * S)):
        record.robot_seen(robot, FIRST, 0)
        record.fact(parse_entry(robot, CLAIM, Version(FIRST, 1), value), at_us)
    record.exited("A", 3 * S + 10_000)
    record.declared_dead("A", FIRST, 3 * S + 20_000)
    (fault,) = record.major
    assert fault.replacement is None
    record.death_recorded("A", FIRST, replace(fault.times, at_us=3 * S - 30_000))
    assert (fault.replacement, fault.reassigned_us) == ("B", 3 * S)
    assert fault.times.at_us == 3 * S - 30_000


def test_when_robots_joined_and_what_conditions_became_are_kept(record: RunRecord) -> None:
    record.robot_seen("A", FIRST, S)
    record.robot_seen("B", FIRST, 2 * S)
    record.robot_seen("A", SECOND, 3 * S)
    for revision, value in ((1, True), (2, False)):
        said = ConditionValue(value, revision, 0).to_value()
        entry = parse_entry("B", f"{CONDITION}/open(1)", Version(FIRST, revision), said)
        record.fact(entry, (3 + revision) * S)
    assert record.joined_us == {"A": S, "B": 2 * S}
    assert list(record.conditions) == [(4 * S, "open(1)", True), (5 * S, "open(1)", False)]


def test_a_robot_that_dies_before_its_first_beat_came_here_is_a_fault(record: RunRecord) -> None:
    """It had joined, since others declare that life dead, and it may have begun to work."""
    claim = Claim("r:0:weld::0", "weld", "weld", Phase.RUNNING, 1).to_value()
    record.robot_seen("B", FIRST, 0)
    record.fact(member("A"), 0)
    record.fact(parse_entry("A", CLAIM, Version(FIRST, 2), claim), 0)
    record.exited("A", S)
    record.declared_dead("A", SECOND, 2 * S)
    assert record.major == [], "of another life nothing is known"
    record.declared_dead("A", FIRST, 2 * S)
    record.fact(parse_entry("B", CLAIM, Version(FIRST, 2), claim), 3 * S)
    (fault,) = record.major
    assert (fault.at_us, fault.detected_us, fault.reassigned_us) == (S, 2 * S, 3 * S)
    assert (fault.held is not None, fault.replacement) == (True, "B")


def test_recorded_times_of_a_death_count_whenever_they_come() -> None:
    known = DeathTimes(S, 2 * S, 3 * S, "B", exact=True)
    for is_first in (True, False):
        record = RunRecord(make_mission(action("weld")))
        record.robot_seen("A", FIRST, 0)
        if is_first:
            record.death_recorded("A", FIRST, known)
        record.declared_dead("A", FIRST, 5 * S)
        record.death_recorded("A", FIRST, known)
        record.exited("A", 4 * S)
        (fault,) = record.major
        assert fault.times == known
        assert (fault.detected_after_us, fault.reassigned_after_us) == (S, 2 * S)
        assert [text for _, text in record.timeline][-1] == "A is dead"
        record.state("A", State.ALIVE, 6 * S, 6 * S)
        record.declared_dead("A", FIRST, 9 * S)
        assert [each.at_us for each in record.major] == [S, 9 * S], "another death of this life"


@pytest.mark.parametrize(
    ("after_us", "text"),
    [(700, "0.7 ms"), (43_105, "43 ms"), (1_234_567, "1.23 s"), (20_000_000, "20.0 s")],
)
def test_how_long_after(after_us: int, text: str) -> None:
    assert after_text(after_us, exact=True) == text
    assert after_text(after_us, exact=False) == f"about {text}"


def test_what_a_robot_began_and_left_before_its_first_beat_came_here_counts() -> None:
    """Recordings have it, as they note robots first."""
    record = RunRecord(make_mission(sequence(action("weld"), action("paint"))))
    lives = (Incarnation(1, "o"), "paint"), (FIRST, "weld"), (FIRST, "paint")
    for number, (life, task) in enumerate(lives):
        phase = Phase.CLAIMED if (life, task) == (FIRST, "paint") else Phase.RUNNING
        claim = Claim(f"r:{number}:{task}::0", task, task, phase, number).to_value()
        record.fact(parse_entry("A", CLAIM, Version(life, number + 1), claim), 0)
    assert not record.task_log.tasks["weld"].robots, "its life may be an earlier one"
    record.robot_seen("A", FIRST, S)
    taken = {name: task.robots for name, task in record.task_log.tasks.items()}
    assert taken == {"weld": {"A"}, "paint": set()}
