"""Operators' commands about jobs: to submit one, to change or cancel it, and where it is kept."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.jobs import KnownJob
from mrbt_mesh.core.facts.records import Job, JobChange, JobState
from mrbt_mesh.core.facts.values import MAX_TEXT
from mrbt_mesh.core.mission.jobs import OpenJob, is_job_id
from mrbt_mesh.core.mission.mission import MAX_PRIORITY
from mrbt_mesh.core.planning.job_ends import job_end, robots_of

MAX_OPEN = 20_000
# Of delays and deadlines: a year.
MAX_JOB_US = 366 * 86_400 * 1_000_000

_CHANGES = ("cancel", "hold", "release", "priority")


class JobError(ValueError):
    """Why a command about a job is refused, in words for the operator."""


class JobDesk:
    """Takes operators' commands about jobs, at one robot. All are JSON in and JSON out."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def submit(self, argument: str, now_us: int) -> str:
        """`{"id", "type", "arguments", "operator"}`, and `"priority"`, `"delay_us"` and
        `"deadline_us"` unless they are as usual: the job's state, as JSON.

        The same id with the same type and arguments again is the same job. Raises JobError.
        """
        given = _read(argument, {"id": str, "type": str, "arguments": list, "operator": str})
        name, kind, arguments = given["id"], given["type"], tuple(given["arguments"])
        facts, mission = self._context.facts, self._context.mission
        if facts.jobs is None:
            raise JobError("this mission has no types of jobs")
        if not is_job_id(name):
            raise JobError(f"{name!r:.80} is no id: 1 to 64 letters, digits, _, ., + or -")
        if kind not in mission.jobs:
            raise JobError(f"no job type {kind!r:.80}; there is {', '.join(sorted(mission.jobs))}")
        known = facts.jobs.known.get(name)
        if known is not None and known.job is not None:
            if (known.job.type, known.job.arguments) != (kind, arguments):
                other = OpenJob(name, known.job.type, known.job.arguments)
                raise JobError(f"there is another job of this id, {other.label}; choose another id")
            return self._state(known)
        if known is not None and known.end is not None:
            return self._state(known)
        if facts.jobs.is_archived(name):
            return json.dumps({"id": name, "state": "ended"})
        if not all(isinstance(each, str) for each in arguments):
            raise JobError("arguments are texts")
        if problem := mission.jobs[kind].problem(arguments):
            raise JobError(problem)
        if not given["operator"].isprintable():
            raise JobError("operator is one line of printable text")
        if facts.jobs.count_open() >= MAX_OPEN:
            raise JobError(f"{MAX_OPEN} jobs are open; cancel some, or wait")
        priority = _priority(given.get("priority", mission.jobs[kind].priority))
        usual_us = mission.jobs[kind].deadline_us or 0
        delay_us = _time(given, "delay_us", 0)
        deadline_us = _time(given, "deadline_us", usual_us)
        operator, stamp = given["operator"][:MAX_TEXT], facts.max_stamp + 1
        job = Job(kind, arguments, priority, delay_us, deadline_us, operator, stamp)
        number = self._context.promise([(f"{records.JOB}/{name}", job)], now_us)
        self._context.note_kept(name, number)
        self._context.log("info", "job_submitted", job=name, type=kind, operator=job.operator)
        return self._state(facts.jobs.known[name])

    def change(self, argument: str, now_us: int) -> str:
        """`{"id", "change"}`, and `"priority"` if that is what is changed: the state, as JSON.

        Raises JobError.
        """
        given = _read(argument, {"id": str, "change": str})
        facts, name, change = self._context.facts, given["id"], given["change"]
        known = facts.jobs.known.get(name) if facts.jobs is not None else None
        if known is None or (known.job is None and known.end is None):
            raise JobError(f"no job {name!r:.80} is known here")
        if change not in _CHANGES:
            raise JobError(f"no change {change!r:.80}; there is {', '.join(_CHANGES)}")
        if known.end is not None or known.job is None:
            return self._state(known)
        before, stamp, job = known.change, facts.max_stamp + 1, known.job
        if change == "cancel":
            robots = robots_of(facts, name)
            end = job_end(job, JobState.CANCELLED, "", robots, stamp)
            number = self._context.promise([(f"{records.JOB_END}/{name}", end)], now_us)
        else:
            is_held = {"hold": True, "release": False}.get(change, before.is_held)
            priority = before.priority
            if change == "priority":
                priority = _priority(given.get("priority"))
            after = JobChange(is_held, priority, stamp)
            number = self._context.promise([(f"{records.JOB_CHANGE}/{name}", after)], now_us)
        self._context.note_kept(name, number)
        self._context.log("info", "job_changed", job=name, change=change)
        return self._state(known)

    def kept(self, argument: str, _: int) -> str:
        """`{"ids": [...]}`: those whose newest facts are in this robot's journal, as JSON."""
        given = _read(argument, {"ids": list})
        jobs, found = self._context.facts.jobs, []
        for name in given["ids"]:
            known = jobs.known.get(name) if jobs is not None and isinstance(name, str) else None
            is_known = known is not None or (jobs is not None and jobs.is_archived(name))
            if is_known and self._context.is_kept(name):
                found.append(name)
        return json.dumps(found)

    def _state(self, known: KnownJob) -> str:
        job, end = known.job, known.end
        state: dict[str, Any] = {
            "id": known.id,
            "state": "held" if known.change.is_held else "open",
        }
        if job is not None:
            state |= {"type": job.type, "arguments": list(job.arguments)}
            state["priority"] = known.priority
        if end is not None:
            state |= {"state": str(end.state), "reason": end.reason, "robots": list(end.robots)}
        return json.dumps(state)


def _read(argument: str, wanted: Mapping[str, type]) -> dict[str, Any]:
    """A JSON object with at least these fields; raises JobError."""
    try:
        given = json.loads(argument)
    except ValueError:
        given = None
    if not isinstance(given, dict):
        raise JobError("a JSON object is expected")
    for name, kind in wanted.items():
        if not isinstance(given.get(name), kind):
            raise JobError(f"{name} is missing, or is no {kind.__name__}")
    return given


def _time(given: Mapping[str, Any], name: str, usual_us: int) -> int:
    value = given.get(name, usual_us)
    if type(value) is not int or not 0 <= value <= MAX_JOB_US:
        raise JobError(f"{name} is a whole number of microseconds, at most {MAX_JOB_US}")
    return value


def _priority(value: Any) -> int:
    if type(value) is not int or abs(value) > MAX_PRIORITY:
        raise JobError(f"a priority is a whole number from -{MAX_PRIORITY} to {MAX_PRIORITY}")
    return value
