"""Checks and encodes a client's requests about jobs, before any robot is asked.

These functions raise only JobRefusedError.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from mrbt_mesh.core.agent.operator_messages import INVALID, OUT_OF_RANGE, UNKNOWN
from mrbt_mesh.core.facts.jobs import hash_of
from mrbt_mesh.core.facts.records import JOB_CANCELLED, JOB_HOLD, JOB_PRIORITY, Hold
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.job_arguments import Arguments, ordered_arguments
from mrbt_mesh.core.mission.mission import MAX_PRIORITY, JobType, Mission
from mrbt_mesh.core.mission.names import is_argument, is_job_id
from mrbt_mesh.errors import nearest
from mrbt_mesh.runtime.local_time import moment_of
from mrbt_mesh.runtime.operator_call import CommandRefusedError

# The largest Unix time that a fact can hold, far beyond any that robots accept.
MAX_UNIX_US = 1 << 53
# Change of a job -> its field and value.
_CHANGES: Mapping[str, tuple[str, Any]] = {
    "cancel": (JOB_CANCELLED, True),
    "hold": (JOB_HOLD, str(Hold.HELD)),
    "hold_now": (JOB_HOLD, str(Hold.NOW)),
    "release": (JOB_HOLD, str(Hold.RELEASED)),
}


class JobRefusedError(CommandRefusedError):
    """A team has refused a job, or a change of one."""

    def __init__(self, text: str, cause: str = INVALID) -> None:
        super().__init__(text, cause)


def arguments_of(mission: Mission, kind: str, given: Arguments) -> list[str]:
    """Return a job's arguments as texts, in the order of its type's parameters.

    They are given as texts and whole numbers, by position or by the parameters' names.
    """
    try:
        return ordered_arguments(job_type(mission, kind), given)
    except ValueError as error:
        raise JobRefusedError(str(error)) from None


def check_job(
    mission: Mission, kind: str, arguments: Sequence[str], job_id: str, priority: int | None
) -> JobType:
    """Return the type of a job; raises for what any robot would refuse."""
    found = job_type(mission, kind)
    if not is_job_id(job_id):
        text = f"{job_id!r:.80} is not an id: 1 to 64 letters, digits, _, ., + or -, not . or .."
        raise JobRefusedError(text)
    if not all(map(is_argument, arguments)) and (problem := found.problem(arguments)):
        raise JobRefusedError(problem)  # for other values robots report it, by their own mission
    if priority is not None:
        check_priority(priority)
    return found


def job_type(mission: Mission, kind: str) -> JobType:
    """Return a mission's job type by name."""
    types = job_types(mission)
    if kind not in types:
        raise JobRefusedError(f"no job type {kind!r:.80}" + nearest(kind, types))
    return types[kind]


def job_types(mission: Mission) -> Mapping[str, JobType]:
    """Return the job types of a mission, which must have some."""
    if not mission.jobs:
        raise JobRefusedError(f"mission {mission.name} has no types of jobs (jobs: in its file)")
    return mission.jobs


def check_priority(priority: Any) -> None:
    """Raise for an invalid priority."""
    if isinstance(priority, bool) or not isinstance(priority, int) or abs(priority) > MAX_PRIORITY:
        text = f"a priority is a whole number from -{MAX_PRIORITY} to {MAX_PRIORITY}"
        raise JobRefusedError(text)


def needs_now(
    kind: JobType, not_before: datetime | timedelta | None, deadline: datetime | timedelta | None
) -> bool:
    """Return whether the times of a job of this type depend on when it is submitted."""
    usual = timedelta() if kind.deadline_us is not None else None
    return any(isinstance(when, timedelta) for when in (not_before, deadline or usual))


def job_value(
    kind: JobType,
    arguments: Sequence[str],
    priority: int | None,
    not_before: datetime | timedelta | None,
    deadline: datetime | timedelta | None,
    now_us: int,
) -> list[Any]:
    """Return the value of the field JOB as plain data.

    `now_us` is the Unix time by the team's clocks, the reference of a timedelta; it matters only if
    the job `needs_now`.
    """
    found = kind.priority if priority is None else priority
    content = [kind.name, *arguments], found, _as_given(not_before), _as_given(deadline)
    not_before_us = _unix_us("not_before", not_before, now_us)
    deadline_us = _unix_us("deadline", deadline, now_us)
    if deadline is None and kind.deadline_us is not None:
        deadline_us = max(now_us, not_before_us) + kind.deadline_us
    hashed = hash_of(json.dumps(content))
    return [kind.name, list(arguments), found, not_before_us, deadline_us, hashed]


def _as_given(when: datetime | timedelta | None) -> str | None:
    """Return a time as it was asked for, relative or absolute.

    The same in each repeated request.
    """
    if when is None:
        return None
    if isinstance(when, datetime):
        return str(round(when.timestamp() * SECOND_US))
    return f"+{when // timedelta(microseconds=1)}"


def _unix_us(field: str, when: datetime | timedelta | None, now_us: int) -> int:
    """Return a time, or a duration from now, as a Unix time in microseconds; 0: none.

    `field` names it in error messages.
    """
    if when is None:
        return 0
    if isinstance(when, timedelta):
        unix_us = now_us + when // timedelta(microseconds=1)
    else:
        try:
            unix_us = round(moment_of(when).timestamp() * SECOND_US)
        except ValueError as error:
            raise JobRefusedError(f"{field}: {error}", OUT_OF_RANGE) from None
    if unix_us <= 0:
        text = f"{field}: before 1970; give a time from now on"
        raise JobRefusedError(text, OUT_OF_RANGE)
    if unix_us > MAX_UNIX_US:
        raise JobRefusedError(f"{field}: at most a year from now", OUT_OF_RANGE)
    return unix_us


def job_change(job_id: str, change: str, priority: int | None = None) -> tuple[str, Any]:
    """Return the field of a change and its value.

    `change` is `cancel`, `hold`, `hold_now`, `release`, or `priority`, which takes the new one.
    """
    if not is_job_id(job_id):
        raise JobRefusedError(f"no job {job_id!r:.80} is known", UNKNOWN)
    if change == "priority":
        check_priority(priority)
        return JOB_PRIORITY, priority
    if change not in _CHANGES:
        known = ", ".join((*_CHANGES, "priority"))
        raise JobRefusedError(f"no change {change!r:.80}; there is {known}")
    return _CHANGES[change]
