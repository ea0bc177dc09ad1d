"""Parse times of jobs as people write them: a moment, a time of today, or seconds from now."""

from __future__ import annotations

import contextlib
from datetime import UTC, datetime, time, timedelta

import click

from mrbt_mesh.runtime.local_time import moment_of

# The longest time from now: a year.
MAX_SECONDS = 366 * 86_400


def time_of(text: str) -> tuple[datetime | timedelta, bool]:
    """Parse a time. Returns (time, whether it is a time of today that has passed).

    A moment is converted to UTC, from the local time zone unless it names another; a time from now
    is a timedelta. Raises ValueError, whose text names the time.
    """
    seconds = -1.0
    with contextlib.suppress(ValueError):
        seconds = float(text) if text.startswith("+") else -1.0
    if seconds > MAX_SECONDS:
        raise ValueError(f"{text:.80}: at most +{MAX_SECONDS} (a year from now)")
    if seconds >= 0:
        return timedelta(seconds=seconds), False
    when, is_of_today = None, False
    with contextlib.suppress(ValueError):
        when = datetime.fromisoformat(text)
    if when is None:
        with contextlib.suppress(ValueError):
            when = datetime.combine(datetime.now().date(), time.fromisoformat(text))
            is_of_today = True
    if when is None:
        expected = "+600 (seconds from now), 14:30 (today), 2026-05-04T14:30 or ...T14:30+02:00"
        raise ValueError(f"{text!r:.80} is not a time: {expected}")
    try:
        moment = moment_of(when).astimezone(UTC)
    except ValueError as error:
        raise ValueError(f"{text}: {error}") from None
    return moment, is_of_today and moment < datetime.now(UTC)


def times_problem(
    not_before: datetime | timedelta | None, deadline: datetime | timedelta | None
) -> str:
    """Return why no robot could ever do a job with these times; empty if one could.

    Times are compared with this machine's clock.
    """
    now = datetime.now(UTC)
    begin, end = (
        now + each if isinstance(each, timedelta) else each for each in (not_before, deadline)
    )
    if end is None or end > max(now, begin or now):
        return ""
    what = "has passed" if end <= now else "is before the time at which it may begin"
    return f"its deadline {what}; give a later one"


def passed_text(text: str) -> str:
    """Return the note for a start time of today that has passed."""
    return f"{text} today has passed: it may begin at once"


def job_time(
    _: click.Context, option: click.Parameter, text: str | None
) -> datetime | timedelta | None:
    """Parse the value of an option that takes a time."""
    if text is None:
        return None
    try:
        when, has_passed = time_of(text)
    except ValueError as error:
        raise click.BadParameter(str(error), param=option) from None
    if has_passed and option.name == "not_before":
        click.echo(passed_text(text), err=True)
    return when


def understood(**times: datetime | timedelta | None) -> dict[str, str]:
    """Return the moments among these times as text in UTC, by name."""
    return {
        name: f"{at:%Y-%m-%dT%H:%M:%SZ}" for name, at in times.items() if isinstance(at, datetime)
    }
