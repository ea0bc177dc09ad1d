"""Which operators' commands about jobs a robot accepts, and what it answers."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.operator_desk import FieldRule, RefusalError, Rules
from mrbt_mesh.core.agent.operator_messages import (
    CONFLICT,
    ENDED,
    FULL,
    NOT_READY,
    OUT_OF_RANGE,
    UNKNOWN,
)
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.jobs import Jobs, KnownJob
from mrbt_mesh.core.facts.records import Hold, Job, JobEnd, OperatorCommand
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.mission.jobs import OpenJob, utc_text

MAX_OPEN = 20_000
# The furthest that times may be ahead: a year.
MAX_JOB_US = 366 * 86_400 * 1_000_000


def job_rules(context: Context) -> Rules:
    """The rules of all fields of jobs."""
    desk = _JobDesk(context)
    change = FieldRule(desk.state, desk.check_change)
    return {
        records.JOB: FieldRule(desk.state, desk.check_new, desk.is_known),
        records.JOB_HOLD: change,
        records.JOB_PRIORITY: change,
        records.JOB_CANCELLED: FieldRule(desk.state, desk.check_change, desk.is_cancelled),
    }


class _JobDesk:
    def __init__(self, context: Context) -> None:
        self._context = context

    @property
    def _jobs(self) -> Jobs:
        """The present index, which is replaced when a key is revoked or a revision is adopted."""
        jobs = self._context.facts.jobs
        assert jobs is not None
        return jobs

    def state(self, name: str) -> dict[str, Any]:
        """The state of a job as plain data, with the id only if there is no such job."""
        known = self._jobs.known.get(name)
        if self._jobs.is_archived(name):
            return {"id": name, "state": str(self._jobs.archived_end(name) or "ended")}
        if known is None or (known.job is None and known.end is None):
            return {"id": name}
        return _state(known)

    def is_known(self, entry: Entry) -> bool:
        """True if this very job has been submitted. Raises RefusalError if another one has."""
        name, job = entry.parts[1], _job(entry)
        if self._jobs.is_archived(name):
            if job.content not in self._jobs.archived_contents(name):
                text = f"a job of the id {name} ended long ago; choose another id"
                raise RefusalError(text, CONFLICT)
            return True
        known = self._jobs.known.get(name)
        found = (known.job or known.written_end) if known is not None else None
        if known is None or found is None:
            return False
        is_same = found.content == job.content or found == job
        if not is_same or (found.type, found.arguments) != (job.type, job.arguments):
            text = f"there is another job of this id, {_description(known, found)}"
            text = f"{text}; it differs in {_difference(found, job)}"
            raise RefusalError(f"{text}; choose another id", CONFLICT)
        return True

    def check_new(self, entry: Entry, now_us: int) -> None:
        """Raises RefusalError if a job cannot be accepted now."""
        job, context = _job(entry), self._context
        for index in context.facts.indexes.values():
            if problem := index.objects_to_job(job):
                raise RefusalError(problem)
        if self._jobs.count_open() >= MAX_OPEN:
            raise RefusalError(f"{MAX_OPEN} jobs are open; cancel some, or wait", FULL)
        clock = context.wall_clock
        team_us = clock.team_us(now_us) if clock is not None else None
        if team_us is None:
            raise RefusalError(f"{context.me} has not read its clock yet", NOT_READY)
        for field, at_us in (("not_before", job.not_before_us), ("deadline", job.deadline_us)):
            if at_us > team_us + MAX_JOB_US:
                text = f"{field}: at most a year from now, by the team's clocks"
                raise RefusalError(text, OUT_OF_RANGE)
        if job.deadline_us and job.deadline_us <= max(team_us, job.not_before_us):
            is_past = job.deadline_us <= team_us
            past = "has passed, by the team's clocks"
            early = "is before the time at which it may begin"
            text = f"its deadline {past if is_past else early}; give a later one"
            raise RefusalError(text, OUT_OF_RANGE)

    def is_cancelled(self, entry: Entry) -> bool:
        """True if a job is already cancelled, so that cancelling it again changes nothing."""
        known = self._jobs.known.get(entry.parts[1])
        return known is not None and known.is_cancelled

    def check_change(self, entry: Entry, _: int) -> None:
        """Raises RefusalError if a job cannot be changed any more."""
        name = entry.parts[1]
        known = self._jobs.known.get(name)
        if self._jobs.is_archived(name):
            raise RefusalError(f"{name} ended long ago", ENDED)
        if known is None or (known.job is None and known.end is None):
            raise RefusalError(f"no job {name!r:.80} is known here", UNKNOWN)
        if known.end is not None:
            raise RefusalError(f"{name} has ended: {known.end.state}", ENDED)


def _job(entry: Entry) -> Job:
    command = entry.record
    assert isinstance(command, OperatorCommand)
    assert isinstance(command.value, Job)
    return command.value


def _description(known: KnownJob, found: Job | JobEnd) -> str:
    """`morning-1: deliver(shelf_2), priority 5`, or how the job has ended."""
    label = OpenJob(known.id, found.type, found.arguments).label
    if isinstance(found, JobEnd):
        return f"{label}, which has ended: {known.end.state if known.end else found.state}"
    times = {"not before": found.not_before_us, "deadline": found.deadline_us}
    shown = [f"{what} {utc_text(us)}" for what, us in times.items() if us]
    return ", ".join([label, f"priority {found.priority}", *shown])


def _difference(found: Job | JobEnd, sent: Job) -> str:
    """`priority (there 5, sent 7)`: all fields in which a job differs from the one sent."""
    fields: dict[str, tuple[Any, Any]] = {
        "type": (found.type, sent.type),
        "arguments": (", ".join(found.arguments), ", ".join(sent.arguments)),
    }
    if isinstance(found, Job):
        fields["priority"] = found.priority, sent.priority
        fields["not_before"] = _time(found.not_before_us), _time(sent.not_before_us)
        fields["deadline"] = _time(found.deadline_us), _time(sent.deadline_us)
    texts = [f"{name} (there {a}, sent {b})" for name, (a, b) in fields.items() if a != b]
    rest = "its times" if isinstance(found, Job) else "its priority or times"
    return ", ".join(texts) or f"{rest}, as they were asked for"


def _time(unix_us: int) -> str:
    return utc_text(unix_us) if unix_us else "none"


def _state(known: KnownJob) -> dict[str, Any]:
    job, end = known.job, known.end
    is_held = known.hold is not Hold.RELEASED
    state: dict[str, Any] = {"id": known.id, "state": "held" if is_held else "open"}
    if job is not None:
        arguments = list(job.arguments)
        state |= {"type": job.type, "arguments": arguments, "priority": known.priority}
    if end is not None:
        reason = known.overruled_text or end.reason
        state |= {"state": str(end.state), "reason": reason, "robots": list(end.robots)}
    return state
