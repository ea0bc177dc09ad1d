"""Operators' commands about jobs: to submit one, to change or cancel it, and where it is kept."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.jobs_on_disk import AwaitedJob
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.jobs import Jobs, KnownJob
from mrbt_mesh.core.facts.records import Job, JobChange, JobState
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.values import MAX_TEXT
from mrbt_mesh.core.mission.jobs import OpenJob
from mrbt_mesh.core.mission.mission import MAX_PRIORITY
from mrbt_mesh.core.mission.names import is_job_id
from mrbt_mesh.core.planning.job_ends import job_end, robots_of

SUBMIT, CHANGE_JOB, KEPT_JOB = JOB_COMMANDS = "submit", "change_job", "kept_job"
MAX_OPEN = 20_000
# Times are not further ahead than this: a year.
MAX_JOB_US = 366 * 86_400 * 1_000_000

_CHANGES = ("cancel", "hold", "release", "priority")


# What is wrong with a command that is refused.
INVALID, UNKNOWN, CONFLICT, FULL = "invalid", "unknown", "conflict", "full"
# Another robot may take it, or this one in a moment.
NOT_READY = "not_ready"


class _RefusedError(ValueError):
    """Why a command about a job is refused, in words for the operator."""

    def __init__(self, text: str, cause: str = INVALID) -> None:
        super().__init__(text)
        self.cause = cause


class JobDesk:
    """Takes operators' commands about jobs, at one robot. All are JSON in and JSON out.

    A command that it does not carry out is answered by `{"refused": why, "cause": ...}`, with one
    of the causes above.
    """

    def __init__(self, context: Context, jobs: Jobs) -> None:
        self._context = context
        self._jobs = jobs
        self._commands: dict[str, Callable[[Mapping[str, Any], int], Any]] = {
            SUBMIT: self._submit,
            CHANGE_JOB: self._change,
            KEPT_JOB: self._kept,
        }

    def answer(self, command: str, argument: str, now_us: int) -> str | AwaitedJob:
        """Carry out one of `JOB_COMMANDS`; its answer, or a job that is awaited."""
        try:
            found = self._commands[command](_read(argument), now_us)
        except _RefusedError as refusal:
            found = {"refused": str(refusal), "cause": refusal.cause}
        return found if isinstance(found, AwaitedJob) else json.dumps(found)

    def _submit(self, given: Mapping[str, Any], now_us: int) -> dict[str, Any]:
        """`{"id", "type", "arguments", "operator"}`, and `"priority"`, `"not_before_us"` and
        `"deadline_us"` (Unix times, 0: none) unless they are as usual: the job's state. In a team
        with keys nothing is left out, and the `"signer"` signs it (`"signature"`, in hex).

        The same id with the same type and arguments again is the same job.
        """
        name, kind, operator = (_text(given, each) for each in ("id", "type", "operator"))
        arguments, types = tuple(_texts(given, "arguments")), self._context.mission.jobs
        if not is_job_id(name):
            raise _RefusedError(f"{name!r:.80} is no id: 1 to 64 letters, digits, _, ., + or -")
        if kind not in types:
            raise _RefusedError(f"no job type {kind!r:.80}; there is {', '.join(sorted(types))}")
        known = self._jobs.known.get(name)
        job = known.job if known is not None else None
        if job is not None and (job.type, job.arguments) != (kind, arguments):
            other = OpenJob(name, job.type, job.arguments).label
            text = f"there is another job of this id, {other}; choose another id"
            raise _RefusedError(text, CONFLICT)
        if known is not None and (job is not None or known.end is not None):
            return _state(known)
        if self._jobs.is_archived(name):
            return {"id": name, "state": "ended", "stamp": 0}
        if problem := types[kind].problem(arguments):
            raise _RefusedError(problem)
        coming = self._context.facts.revisions.pending(self._context.mission.revision_number)
        if coming is not None and kind not in coming[1].jobs:
            raise _RefusedError(f"a revision without jobs of type {kind} is about to be in force")
        if coming is not None and (problem := coming[1].jobs[kind].problem(arguments)):
            raise _RefusedError(f"a revision is about to be in force in which {problem}")
        if self._jobs.count_open() >= MAX_OPEN:
            raise _RefusedError(f"{MAX_OPEN} jobs are open; cancel some, or wait", FULL)
        not_before_us, deadline_us = self._times(given, types[kind].deadline_us, now_us)
        job = Job(
            kind,
            arguments,
            _priority(given.get("priority", types[kind].priority)),
            not_before_us,
            deadline_us,
            operator,
            self._context.facts.max_stamp + 1,
            *(_text(given, each) if each in given else "" for each in ("signer", "signature")),
        )
        if not self._context.replica.is_by_operator(f"{records.JOB}/{name}", job):
            raise _RefusedError("no operator of this team has signed it")
        self._write(name, (f"{records.JOB}/{name}", job), now_us)
        self._context.log("info", "job_submitted", job=name, type=kind, operator=job.operator)
        return _state(self._jobs.known[name])

    def _times(
        self, given: Mapping[str, Any], usual_us: int | None, now_us: int
    ) -> tuple[int, int]:
        """From when on it may begin, and when it expires: after `usual_us`, unless it says when."""
        clock = self._context.wall_clock
        team_us = clock.team_us(now_us) if clock is not None else None
        if team_us is None:
            raise _RefusedError(f"{self._context.me} has not read its clock yet", NOT_READY)
        not_before_us = _time(given, "not_before_us", 0, team_us)
        usual_deadline_us = 0 if usual_us is None else max(team_us, not_before_us) + usual_us
        deadline_us = _time(given, "deadline_us", usual_deadline_us, team_us)
        if deadline_us and deadline_us <= max(team_us, not_before_us):
            past = (
                "has passed, by the team's clocks"
                if deadline_us <= team_us
                else ("is before the time at which it may begin")
            )
            raise _RefusedError(f"its deadline {past}; give a later one")
        return not_before_us, deadline_us

    def _change(self, given: Mapping[str, Any], now_us: int) -> dict[str, Any]:
        """`{"id", "change"}`, and `"priority"` if that is what is changed: the job's state."""
        name, change = _text(given, "id"), _text(given, "change")
        known = self._jobs.known.get(name)
        if known is None or (known.job is None and known.end is None):
            raise _RefusedError(f"no job {name!r:.80} is known here", UNKNOWN)
        if change not in _CHANGES:
            raise _RefusedError(f"no change {change!r:.80}; there is {', '.join(_CHANGES)}")
        job, before, stamp = known.job, known.change, self._context.facts.max_stamp + 1
        if known.end is not None or job is None:
            return _state(known)
        if change == "cancel":
            robots = robots_of(self._context.facts, name)
            end = job_end(job, JobState.CANCELLED, "", robots, stamp)
            self._write(name, (f"{records.JOB_END}/{name}", end), now_us)
        else:
            is_held = {"hold": True, "release": False}.get(change, before.is_held)
            is_priority = change == "priority"
            priority = _priority(given.get("priority")) if is_priority else before.priority
            after = JobChange(is_held, priority, stamp)
            self._write(name, (f"{records.JOB_CHANGE}/{name}", after), now_us)
        self._context.log("info", "job_changed", job=name, change=change)
        return _state(known)

    def _kept(self, given: Mapping[str, Any], _: int) -> AwaitedJob:
        """`{"id", "stamp"}`: answered once this robot's journal has all facts of the job up to the
        stamp.
        """
        name, stamp = _text(given, "id"), given.get("stamp")
        if type(stamp) is not int:
            raise _RefusedError("stamp is missing, or is no whole number")
        return AwaitedJob(name, stamp)

    def _write(self, name: str, fact: Fact, now_us: int) -> None:
        self._context.jobs_on_disk.note(name, self._context.promise([fact], now_us))


def _state(known: KnownJob) -> dict[str, Any]:
    job, end = known.job, known.end
    is_held = known.change.is_held
    state: dict[str, Any] = {"id": known.id, "state": "held" if is_held else "open"}
    state["stamp"] = known.stamp
    if job is not None:
        arguments = list(job.arguments)
        state |= {"type": job.type, "arguments": arguments, "priority": known.priority}
    if end is not None:
        state |= {"state": str(end.state), "reason": end.reason, "robots": list(end.robots)}
    return state


def _read(argument: str) -> Mapping[str, Any]:
    """A JSON object."""
    try:
        given = json.loads(argument)
    except (ValueError, RecursionError):
        given = None
    if not isinstance(given, dict):
        raise _RefusedError("a JSON object is expected")
    return given


def _text(given: Mapping[str, Any], name: str) -> str:
    value = given.get(name)
    if not isinstance(value, str) or not value.isprintable() or len(value) > MAX_TEXT:
        text = f"not one line of printable text of at most {MAX_TEXT} characters"
        raise _RefusedError(f"{name} is missing, or is {text}")
    return value


def _texts(given: Mapping[str, Any], name: str) -> list[str]:
    values = given.get(name)
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise _RefusedError(f"{name} is missing, or is no list of texts")
    return values


def _time(given: Mapping[str, Any], name: str, usual_us: int, now_us: int) -> int:
    value = given.get(name, usual_us)
    if type(value) is not int or not 0 <= value <= now_us + MAX_JOB_US:
        raise _RefusedError(
            f"{name} is a Unix time in whole microseconds, at most a year from now; 0: none"
        )
    return value


def _priority(value: Any) -> int:
    if type(value) is not int or abs(value) > MAX_PRIORITY:
        raise _RefusedError(f"a priority is a whole number from -{MAX_PRIORITY} to {MAX_PRIORITY}")
    return value
