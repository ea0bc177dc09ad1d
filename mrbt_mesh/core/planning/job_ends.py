"""How jobs end: from the statuses of their trees to facts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import Evaluation, JobEnded
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.jobs import Jobs, KnownJob
from mrbt_mesh.core.facts.records import JobEnd, JobState, Outcome
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.failure_reasons import one_line


def job_ends(
    facts: TeamFacts, evaluation: Evaluation, returned: tuple[str, str] = ("", "")
) -> list[Fact]:
    """The facts of the jobs whose trees have succeeded or failed in this evaluation.

    `returned`: a job, and a robot whose outcome in it is not among the facts yet.
    """
    job, robot = returned
    return [
        (f"{records.JOB_END}/{ended.job}", _end(facts, ended, robot if ended.job == job else ""))
        for ended in evaluation.job_ends
    ]


def cancelled_ends(facts: TeamFacts) -> list[Fact]:
    """The facts of the jobs that were cancelled, of which no robot has written the end yet."""
    cancelled = facts.jobs.cancelled() if facts.jobs is not None else []
    return [
        (f"{records.JOB_END}/{known.id}", job_end(facts, known, JobState.CANCELLED))
        for known in cancelled
    ]


def ends_to_write(
    facts: TeamFacts, jobs: Jobs, evaluation: Evaluation, me: str, alive: Collection[str]
) -> list[Fact]:
    """The ends that it is this robot's turn to write: for as many as have to, those of jobs that
    have ended in this evaluation; for one, those of cancelled jobs, and those that too few have
    written.
    """
    found: list[Fact] = []
    if me in sorted(alive)[: jobs.witnesses]:
        ends = job_ends(facts, evaluation)
        found += [(name, end) for name, end in ends if facts.map.get(me, name) is None]
    if me == min(alive):
        found += cancelled_ends(facts)
    for known in jobs.unsettled():
        written, others = known.written_end, set(alive) - known.ends.keys()
        if written is not None and others and me == min(others):
            found.append((f"{records.JOB_END}/{known.id}", written))
    return found


def _end(facts: TeamFacts, ended: JobEnded, robot: str) -> JobEnd:
    assert facts.jobs is not None
    state = JobState.SUCCEEDED if ended.success else JobState.FAILED
    reason = "" if ended.success else _reason(facts, ended)
    end = job_end(facts, facts.jobs.known[ended.job], state, reason)
    return replace(end, robots=tuple(sorted({*end.robots, robot} - {""})))


def job_end(facts: TeamFacts, known: KnownJob, state: JobState, reason: str = "") -> JobEnd:
    """The record of a job's end."""
    job, robots = known.job, robots_of(facts, known.id)
    assert job is not None
    operator, stamp = known.commanded_by(records.JOB), facts.max_stamp + 1
    return JobEnd(state, job.type, job.arguments, operator, reason, robots, stamp, job.content)


def robots_of(facts: TeamFacts, job: str) -> tuple[str, ...]:
    """The robots that have ended a local task of the job, sorted."""
    known = facts.jobs.known.get(job) if facts.jobs is not None else None
    names = known.activations if known is not None else {}
    keys = (key for name in names for key in facts.activations[name].keys)
    return tuple(sorted({robot for robot, name in keys if name.startswith(records.OUTCOME)}))


def _reason(facts: TeamFacts, ended: JobEnded) -> str:
    """Why a job's tree has failed: the first action that did, and what its robot says of it."""
    for activation in ended.failures:
        said = facts.activations.get(activation)
        for robot, name in sorted(said.keys if said is not None else ()):
            entry = facts.map.get(robot, name)
            record = entry.record if entry is not None else None
            if entry is not None and isinstance(record, Outcome) and not record.success:
                reason = f": {record.reason}" if record.reason else ""
                return one_line(f"{robot} failed to {entry.parts[2]}{reason}")
        return f"{parse_activation(activation).subject} failed"
    return "a condition of its tree does not hold"
