"""The jobs of a team as people see them: the state of each, why, and who works on it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.jobs import KnownJob
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import JobType
from mrbt_mesh.core.planning.plan import Plan

HELD, WAITING, RUNNING = "held", "waiting", "running"


@dataclass(frozen=True, slots=True)
class JobRow:
    """One job. `state`: held, waiting, running, succeeded, failed, cancelled or expired.

    `arguments`: parameter -> value. `why`: what it waits for, or why it has failed. `robots`: those
    that work on it, or have.
    `not_before_us`, `deadline_us`: Unix times, 0 if there is none or it has ended.
    """

    id: str
    type: str
    arguments: dict[str, str]
    state: str
    why: str
    priority: int
    robots: tuple[str, ...]
    operator: str
    not_before_us: int = 0
    deadline_us: int = 0


def job_rows(facts: TeamFacts, plan: Plan | None, alive: Collection[str]) -> list[JobRow]:
    """All jobs that are known: those that are open in their order, then those that have ended."""
    if facts.jobs is None:
        return []
    working: dict[str, list[str]] = {}
    for robot in sorted(alive):
        claim = facts.valid_claim(robot)
        if claim is not None and claim.phase is not Phase.CLAIMED:
            working.setdefault(parse_activation(claim.activation).job, []).append(robot)
    reasons = _reasons(plan)
    in_tree = {job.id for job in facts.jobs.in_tree()}
    types, rows, ended = facts.mission.jobs, [], []
    for known in facts.jobs:
        if known.end is not None:
            ended.append((-known.end.stamp, _ended(known, types)))
        elif known.job is not None:
            arguments = types[known.job.type].values_of(known.job.arguments)
            row = _open(known, arguments, working.get(known.id, []), reasons, known.id in in_tree)
            rows.append(((-known.priority, known.job.stamp, known.id), row))
    return [row for _, row in sorted(rows)] + [row for _, row in sorted(ended, key=lambda e: e[0])]


def _ended(known: KnownJob, types: Mapping[str, JobType]) -> JobRow:
    end = known.end
    assert end is not None
    return JobRow(
        known.id,
        end.type,
        types[end.type].values_of(end.arguments),
        str(end.state),
        end.reason,
        known.priority,
        end.robots,
        end.operator,
    )


def _open(
    known: KnownJob,
    arguments: dict[str, str],
    robots: list[str],
    reasons: Mapping[str, str],
    is_in_tree: bool,
) -> JobRow:
    job = known.job
    assert job is not None
    state, why = WAITING, reasons.get(known.id, "")
    if robots:
        state, why = RUNNING, ""
    elif known.change.is_held:
        state = HELD
    elif not known.is_due:
        why = f"not before {datetime.fromtimestamp(job.not_before_us // 1_000_000, UTC):%F %T} UTC"
    elif not is_in_tree:
        why = "behind others"
    shown = tuple(robots)
    return JobRow(
        known.id,
        job.type,
        arguments,
        state,
        why,
        known.priority,
        shown,
        job.operator,
        job.not_before_us,
        job.deadline_us,
    )


def _reasons(plan: Plan | None) -> dict[str, str]:
    """Job -> what its first request waits for."""
    found: dict[str, str] = {}
    for waiting in plan.waiting if plan is not None else ():
        job = parse_activation(waiting.activation).job
        if job:
            found.setdefault(job, waiting.reason)
    return found
