"""Interprets local times without an offset, and refuses those that are not a unique moment."""

from __future__ import annotations

import os
import re
import zoneinfo
from datetime import MAXYEAR, MINYEAR, UTC, datetime

# Zones written out, as in `CET-1CEST` (POSIX).
_WRITTEN_OUT = re.compile(r"([A-Za-z]{3,}|<[A-Za-z0-9+-]{3,}>)[+-]?\d.*|UTC|GMT", re.ASCII)


def moment_of(when: datetime) -> datetime:
    """Return a time with an offset unchanged; interpret one without in the machine's time zone.

    Raises ValueError for a time that the clocks there skip or show twice; for a zone unknown to
    this machine, which the system would treat as UTC, or 24 hours or more from UTC; and for the
    first and the last possible year, whose times may not exist in other zones.
    """
    if when.year >= MAXYEAR:
        raise ValueError("give a time that is at most a year from now")
    if when.year <= MINYEAR:
        raise ValueError("before 1970; give a time from now on")
    if when.tzinfo is not None:
        return when
    zone = os.environ.get("TZ", "").removeprefix(":")
    if zone and not _is_known(zone):
        raise ValueError(
            f"this machine knows no time zone {zone!r:.80} (TZ): give the time with its offset, "
            f"{when.isoformat()}+01:00, or install the zones (tzdata)"
        )
    try:
        early, late = (when.replace(fold=fold).astimezone() for fold in (0, 1))
    except (ValueError, OverflowError):
        raise ValueError(
            f"the time zone {zone!r:.80} (TZ) is 24 hours or more from UTC, which no zone is: "
            f"correct it, or give the time with its offset, {when.isoformat()}+01:00"
        ) from None
    if early.utcoffset() == late.utcoffset():
        return early
    # A skipped time converts back to another time of day.
    is_skipped = early.astimezone(UTC).astimezone().replace(tzinfo=None, fold=0) != when
    what = "is skipped by the clocks" if is_skipped else "comes twice"
    raise ValueError(
        f"{when.isoformat()} {what} in this time zone, since summer time begins or ends: give it "
        f"with its offset, {early.isoformat()} or {late.isoformat()}"
    )


def _is_known(zone: str) -> bool:
    if _WRITTEN_OUT.fullmatch(zone) or zone.startswith("/"):
        return True
    try:
        zoneinfo.ZoneInfo(zone)
    except (ValueError, OSError, zoneinfo.ZoneInfoNotFoundError):
        return False
    return True
