"""The end of a job that nobody worked on does not follow from anything, whoever writes it."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.records import JobEnd, JobState, Latch, Outcome
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.recording.metadata import RunMetadata
from mrbt_mesh.recording.reader import RecordedMessages, Recording
from mrbt_mesh.views.replay.check_derived import CLOCKS_US, DerivedCheck, due_us, early
from mrbt_mesh.views.replay.checked_recording import CheckedRecording, RecordedFact
from tests.support.commands import command, submission

MISSION = mission_from_yaml(
    """
mission: m
ends: never
local_tasks: {look: {parameters: [where], work: 1}}
robot_types: {t: {capabilities: {look: 1}}}
robots: {R1: t, R2: t, R3: t}
global_tasks: {check: {parameters: [where], needs: {look($where): {min: 1}}}}
jobs: {inspect: {parameters: {where: [a, b]}, tree: check($where)}}
tree: {Jobs: {types: [inspect], at_most: 3}}
""",
    "m.yaml",
    Path(),
)
LIFE = Incarnation(1, "n")
DUE_US = 2_000_000_000_000_000


def entry(author: str, name: str, record: object, sequence: int = 5) -> Entry:
    value = record.to_value()  # type: ignore[attr-defined]
    return parse_entry(author, name, Version(LIFE, sequence), value)


def end(state: JobState, *robots: str) -> Entry:
    return entry("R3", "job_end/v0", JobEnd(state, "inspect", ("a",), "op", "", robots, 9))


@pytest.fixture
def facts() -> TeamFacts:
    """One job is open, which may not begin before long."""
    found = TeamFacts(MISSION, "r")
    times = {"not_before_us": DUE_US, "deadline_us": DUE_US + 60_000_000}
    found.map.merge([submission("v0", "inspect", "a", **times)])
    return found


def test_a_job_is_cancelled_by_an_operator_alone(facts: TeamFacts) -> None:
    check = DerivedCheck()
    check.planned(facts, make_plan(facts, {}, default_solver))
    with pytest.raises(ValueError, match="no operator has cancelled v0"):
        check.own(end(JobState.CANCELLED), 7)
    facts.map.merge([command("job_cancelled/v0", True)])
    check.own(end(JobState.CANCELLED), 7)


@pytest.mark.parametrize("state", [JobState.SUCCEEDED, JobState.FAILED])
def test_an_end_that_nothing_leads_to(facts: TeamFacts, state: JobState) -> None:
    check = DerivedCheck()
    check.planned(facts, make_plan(facts, {}, default_solver))
    with pytest.raises(ValueError, match=f"v0 has {state} by R1, which does not follow"):
        check.own(end(state, "R1"), 10)


def test_the_tick_of_an_outcome_may_end_a_job(facts: TeamFacts) -> None:
    """Its own outcome is what the robot answers for; that it had work is checked elsewhere."""
    check = DerivedCheck()
    check.planned(facts, make_plan(facts, {}, default_solver))
    check.own(entry("R3", "outcome/r:0:j@v0:check::0/look(a)", Outcome(True, None)), 10)
    check.own(end(JobState.SUCCEEDED, "R3"), 10)
    with pytest.raises(ValueError, match="does not follow"):
        check.own(end(JobState.SUCCEEDED, "R3"), 11)


def test_a_robot_may_repeat_the_end_that_another_one_has_written(facts: TeamFacts) -> None:
    """It counts: its author returned from work in it in that very tick."""
    done = JobEnd(JobState.SUCCEEDED, "inspect", ("a",), "op", "", ("R1",), 9)
    written = entry("R1", "job_end/v0", done)
    facts.map.merge([written, entry("R2", "job_due/v0", Latch())])
    check = DerivedCheck()
    check.planned(facts, make_plan(facts, {}, default_solver))
    with pytest.raises(ValueError, match="does not follow"):
        check.own(end(JobState.SUCCEEDED, "R1"), 10)
    facts.map.merge([entry("R1", "outcome/r:1@v0:check(a)::0/look(a)", Outcome(True, None))])
    check.planned(facts, make_plan(facts, {}, default_solver))
    check.own(end(JobState.SUCCEEDED, "R1"), 10)


def test_times_before_which_facts_are_false(facts: TeamFacts) -> None:
    assert due_us(facts, entry("R3", "job_due/v0", Latch())) == DUE_US
    assert due_us(facts, end(JobState.EXPIRED)) == DUE_US + 60_000_000
    assert due_us(facts, end(JobState.CANCELLED)) is None


def test_a_fact_is_early_if_all_recordings_have_it_before_its_time(facts: TeamFacts) -> None:
    late = entry("R3", "job_due/v0", Latch())
    for before_us, is_found in ((CLOCKS_US + 1, True), (CLOCKS_US - 1, False)):
        checks = []
        for ahead_us in (0, 1_000):
            metadata = RunMetadata.of(MISSION, "R1", "r", Timing(), 10**18, "1")
            recording = Recording(
                Path("R1.mcap"), metadata, RecordedMessages.__new__(RecordedMessages)
            )
            check = CheckedRecording(recording, MISSION)
            at_us = DUE_US - 10**15 - before_us - ahead_us
            fact = RecordedFact(1, at_us, "R3", "job_due/v0", late.version, late.hash, b"")
            check.timed.append((fact, DUE_US))
            checks.append(check)
        assert bool(list(early(checks))) is is_found
