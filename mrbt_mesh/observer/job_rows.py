"""The jobs of a team as people see them: the state of each, why, and who works on it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.jobs import KnownJob
from mrbt_mesh.core.facts.records import JOB, Hold, JobState, Phase, TeamOrder
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.job_arguments import Argument, named_arguments
from mrbt_mesh.core.mission.jobs import utc_text
from mrbt_mesh.core.mission.mission import JobType
from mrbt_mesh.core.mission.names import name_order
from mrbt_mesh.core.planning.plan import UNDECIDED, Plan
from mrbt_mesh.observer.observer import Observer

HELD, WAITING, RUNNING = "held", "waiting", "running"
NOT_BEFORE, NO_PLACE = "not before", "the mission in force has no place for it"
PAUSED = "the team is paused"
UNCONFIRMED = "its tree has ended, which a second robot has to confirm"


@dataclass(frozen=True, slots=True)
class JobRow:
    """One job. `state`: held, waiting, running, succeeded, failed, cancelled or expired. Where the
    mission was aborted, or is over, all that were open are cancelled.

    `arguments`: parameter -> value, a number where the parameter is one. `why`: what it waits for,
    or why it has failed. `robots`: those that work on it, else those that have. Times are Unix
    times. `not_before_us`, `deadline_us`: 0 if there is none. Of a job that had ended before it was
    observed these and `priority` are None, as only its end is kept. What follows is as the observer
    has seen it: `submitted_us`, `begun_us`, `ended_us` are None if that has not happened while it
    watched, `attempts` is how often the job's tree has begun, and `results` are the entries that
    its tasks have set.
    """

    id: str
    type: str
    arguments: dict[str, Argument]
    state: str
    why: str
    priority: int | None
    robots: tuple[str, ...]
    operator: str
    not_before_us: int | None = 0
    deadline_us: int | None = 0
    submitted_us: int | None = None
    begun_us: int | None = None
    ended_us: int | None = None
    attempts: int = 0
    results: dict[str, str] = field(default_factory=dict)


class JobRows:
    """The rows of one observer. Those of which nothing has changed are the same objects as before,
    so 10,000 open jobs cost little while a few are worked on.
    """

    def __init__(self) -> None:
        # Id -> what a row was made of: the job, its version; its place among all; the row.
        self._made: dict[str, tuple[KnownJob, int, tuple[int, ...], JobRow]] = {}
        # Of a mission that is over: id -> an open row, and how it is shown.
        self._over: dict[str, tuple[JobRow, JobRow]] = {}
        # Those whose rows depend on more than their own facts.
        self._lively: frozenset[str] = frozenset()

    def place(self, job: str) -> tuple[tuple[int, ...], str]:
        """Where a job of the last `update` is among all: larger than those before it."""
        return self._made[job][2], job

    def of(self, observer: Observer) -> list[JobRow]:
        """Those of an observer, with what it has seen of them."""
        ahead_us = observer.clock_ahead_us()
        jobs = observer.record.job_log.jobs

        def seen(row: JobRow) -> JobRow:
            history = jobs.get(row.id)
            if history is None:
                return row
            has_ended, robots = row.state not in (HELD, WAITING, RUNNING), row.robots
            if has_ended:
                row = replace(
                    row,
                    priority=history.priority,
                    not_before_us=history.not_before_us,
                    deadline_us=history.deadline_us,
                )
            if row.state != RUNNING:
                robots = tuple(sorted(history.worked.union(robots), key=name_order))
            return replace(
                row,
                robots=robots,
                submitted_us=history.unix_us("submitted", ahead_us),
                begun_us=history.unix_us("begun", ahead_us),
                ended_us=history.unix_us("ended", ahead_us) if has_ended else None,
                attempts=history.attempts,
                results=dict(history.results),
            )

        peers = observer.membership.peers.items()
        # The player of a recording knows peers, and counts on nobody.
        alive = [robot for robot, each in peers if each.state.is_member and each.report.has_joined]
        rows = self.update(observer.facts, observer.plan, alive, seen)
        why, over_us = why_over(observer), observer.record.job_log.over_us
        if not why:
            return rows
        ended_us = None if over_us is None or ahead_us is None else over_us + ahead_us

        def given_up(row: JobRow) -> JobRow:
            history = jobs.get(row.id)
            worked = history.worked if history is not None else ()
            robots = tuple(sorted({*worked, *row.robots}))
            state = str(JobState.CANCELLED)
            return replace(row, state=state, why=why, robots=robots, ended_us=ended_us)

        return [self._given_up(row, given_up) for row in rows]

    def _given_up(self, row: JobRow, given_up: Callable[[JobRow], JobRow]) -> JobRow:
        """A row of a mission that is over: nobody does an open job any more."""
        if row.state not in (HELD, WAITING, RUNNING):
            return row
        before, shown = self._over.get(row.id, (None, row))
        if before != row:
            shown = given_up(row)
            self._over[row.id] = row, shown
        return shown

    def update(
        self,
        facts: TeamFacts,
        plan: Plan | None,
        alive: Collection[str],
        seen: Callable[[JobRow], JobRow] = lambda row: row,
    ) -> list[JobRow]:
        """All jobs that are known: open ones in their order, then those that have ended, the newest
        first. `seen`: a row with what follows from no facts; called when a row is made anew.
        """
        if facts.jobs is None:
            return []
        working: dict[str, list[str]] = {}
        for robot in sorted(alive, key=name_order):
            claim = facts.valid_claim(robot)
            if claim is not None and claim.phase is not Phase.CLAIMED:
                working.setdefault(parse_activation(claim.activation).job, []).append(robot)
        reasons = _reasons(plan)
        in_tree = {job.id for job in facts.jobs.in_tree()}
        behind = _behind(in_tree, reasons)
        over = {each.job for each in plan.evaluation.job_ends} if plan is not None else set[str]()
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
                made[name] = known, known.version, when, seen(_ended(known, types))
            elif known.job is not None:
                why = reasons.get(name, "")
                if not facts.jobs.fits(known.job):
                    why = NO_PLACE
                elif name not in in_tree:
                    why = behind
                elif name in over:
                    why = UNCONFIRMED
                elif not why and facts.order() is TeamOrder.PAUSE:
                    why = PAUSED
                arguments = named_arguments(types, known.job.type, known.job.arguments)
                row = _open(known, arguments, working.get(name, []), why)
                place = (0, -known.priority, known.arrival)
                made[name] = known, known.version, place, seen(row)
        self._made, self._lively = made, lively
        order = sorted((place, name) for name, (_, _, place, _) in made.items())
        return [made[name][3] for _, name in order]


def left_behind(row: JobRow) -> JobRow:
    """A row of a team that does not run: that no robot is there holds for all jobs and is no
    reason, what follows from facts about this one is.
    """
    is_own = row.why.startswith((NOT_BEFORE, NO_PLACE)) or UNDECIDED in row.why
    is_open = row.state in (HELD, WAITING, RUNNING)
    return replace(row, why="") if is_open and not is_own else row


def why_over(observer: Observer) -> str:
    """Why no open job goes on any more; empty: they do."""
    if observer.facts.order() is TeamOrder.ABORT:
        return "the mission was aborted"
    return "" if observer.record.result is None else "the mission is over"


def _behind(in_tree: Collection[str], reasons: Mapping[str, str]) -> str:
    """Why a job is not in the tree: it is full, perhaps of jobs that an operator has to decide."""
    doubted = sum(reasons.get(job, "").startswith(f"blocked: {UNDECIDED}") for job in in_tree)
    more = f", {doubted} of them in doubt (`mrbt decide`)" if doubted else ""
    return f"behind others{more}"


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
        None,
        end.robots,
        end.operator,
        None,
        None,
    )


def _open(
    known: KnownJob,
    arguments: dict[str, Argument],
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
        why = f"{NOT_BEFORE} {utc_text(job.not_before_us)}"
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
    return found | _scheduled(plan, found)


def _scheduled(plan: Plan | None, known: Collection[str]) -> dict[str, str]:
    """Job -> the robots that the schedule has for its first request, if they do other work first.

    Without jobs that are `known` to wait for something else.
    """
    found: dict[str, str] = {}
    if plan is None or plan.ahead is None:
        return found
    begun = {each.activation for each in plan.assignments.values()}
    for request in plan.evaluation.requests:
        step, job = plan.ahead.step_of(request.activation), parse_activation(request.activation).job
        if job and job not in known and step is not None and request.activation not in begun:
            found.setdefault(job, f"for {', '.join(plan.ahead.members(step))}, by the schedule")
    return found
