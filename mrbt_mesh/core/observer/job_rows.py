"""The jobs of a team as people see them: the state of each, why, and who works on it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.jobs import KnownJob
from mrbt_mesh.core.facts.records import JOB, Hold, Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.jobs import named_arguments
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


class JobRows:
    """The rows of one observer. Those of which nothing has changed are the same objects as before,
    so 10,000 open jobs cost little while a few are worked on.
    """

    def __init__(self) -> None:
        # Id -> what a row was made of: the job, its version; its place among all; the row.
        self._made: dict[str, tuple[KnownJob, int, tuple[int, ...], JobRow]] = {}
        # Those whose rows depend on more than their own facts.
        self._lively: frozenset[str] = frozenset()

    def update(self, facts: TeamFacts, plan: Plan | None, alive: Collection[str]) -> list[JobRow]:
        """All jobs that are known: open ones in their order, then those that have ended, the newest
        first.
        """
        if facts.jobs is None:
            return []
        working: dict[str, list[str]] = {}
        for robot in sorted(alive):
            claim = facts.valid_claim(robot)
            if claim is not None and claim.phase is not Phase.CLAIMED:
                working.setdefault(parse_activation(claim.activation).job, []).append(robot)
        reasons = _reasons(plan)
        in_tree = {job.id for job in facts.jobs.in_tree()}
        before, types = self._made, facts.mission.jobs
        made: dict[str, tuple[KnownJob, int, tuple[int, ...], JobRow]] = {}
        lively = frozenset((*working, *reasons, *in_tree))
        for name, known in facts.jobs.known.items():
            found = before.get(name)
            if (
                found is not None
                and found[0] is known
                and found[1] == known.version
                and name not in lively
                and name not in self._lively
            ):
                made[name] = found
            elif known.end is not None:
                when = (1, -known.end.stamp)
                made[name] = known, known.version, when, _ended(known, types)
            elif known.job is not None:
                why = reasons.get(name, "")
                if not facts.jobs.fits(known.job):
                    why = "the mission in force has no place for it"
                elif name not in in_tree:
                    why = "behind others"
                arguments = named_arguments(types, known.job.type, known.job.arguments)
                row = _open(known, arguments, working.get(name, []), why)
                place = (0, -known.priority, known.arrival)
                made[name] = known, known.version, place, row
        self._made, self._lively = made, lively
        order = sorted((place, name) for name, (_, _, place, _) in made.items())
        return [made[name][3] for _, name in order]


def _ended(known: KnownJob, types: Mapping[str, JobType]) -> JobRow:
    end = known.end
    assert end is not None
    why = known.overruled_text or end.reason
    return JobRow(
        known.id,
        end.type,
        named_arguments(types, end.type, end.arguments),
        str(end.state),
        why,
        known.priority,
        end.robots,
        end.operator,
    )


def _open(
    known: KnownJob,
    arguments: dict[str, str],
    robots: list[str],
    why: str,
) -> JobRow:
    """`why`: what it waits for, if nothing else is in the way."""
    job = known.job
    assert job is not None
    state = WAITING
    if robots:
        state, why = RUNNING, ""
    elif known.hold is not Hold.RELEASED:
        state, why = HELD, ""
    elif not known.is_due:
        why = f"not before {datetime.fromtimestamp(job.not_before_us // 1_000_000, UTC):%F %T} UTC"
    shown = tuple(robots)
    return JobRow(
        known.id,
        job.type,
        arguments,
        state,
        why,
        known.priority,
        shown,
        known.commanded_by(JOB),
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
