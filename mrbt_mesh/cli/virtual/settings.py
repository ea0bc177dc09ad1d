"""How rates and chances of failures are written on the command line."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.sim.world.setup import Rate, losable


def parse_rates(option: str, texts: Sequence[str], mission: Mission) -> dict[str, Rate]:
    """Robot, type or EVERYBODY -> rate, of texts like `0.1`, `0.1/action`, `A1:2/hour`."""
    rates: dict[str, Rate] = {}
    given: dict[object, str] = {}
    known = [*sorted(mission.robots), *sorted({r.type for r in mission.robots.values()})]
    for text in texts:
        name, _, number = text.rpartition(":")
        if name and name not in known:
            raise InputError(f"--{option} {text}: no robot or type {name!r} ({', '.join(known)})")
        unit = "hour" if number.endswith("/hour") else "action"
        _refuse_second(option, text, (name, unit), given)
        before, more = rates.get(name, Rate()), _parse_rate(option, number)
        rates[name] = Rate(more.per_action or before.per_action, more.per_hour or before.per_hour)
    return rates


def parse_chances(option: str, texts: Sequence[str], mission: Mission) -> dict[str, float]:
    """Local task or EVERYBODY -> chance, of texts like `0.1` or `move_frame:0.2`."""
    chances: dict[str, float] = {}
    given: dict[object, str] = {}
    for text in texts:
        name, _, number = text.rpartition(":")
        value = _number(number)
        if name and name not in mission.local_tasks:
            known = ", ".join(sorted(mission.local_tasks))
            raise InputError(f"--{option} {text}: no local task {name!r} ({known})")
        if value is None or value > 1:
            raise InputError(f"--{option} {text}: a chance is from 0 to 1")
        _refuse_second(option, text, name, given)
        chances[name] = value
    return chances


def check_counts(mission: Mission, major: int, minor: int) -> None:
    """Raise InputError for more faults than the team has robots or capabilities."""
    for option, number, most, what in (
        ("major", major, len(mission.robots), "robots"),
        ("minor", minor, len(losable(mission)), "capabilities"),
    ):
        if number > most:
            raise InputError(f"--{option} {number}: the team has only {most} {what} to lose")


def _parse_rate(option: str, text: str) -> Rate:
    """`0.1` and `0.1/action`: a chance per action; `2/hour`: a mean number per hour."""
    number, _, unit = text.partition("/")
    value = _number(number)
    if value is None or unit not in ("", "action", "hour"):
        raise InputError(f"--{option} {text}: expected e.g. 0.1/action or 2/hour")
    if unit == "hour":
        return Rate(per_hour=value)
    if value > 1:
        raise InputError(f"--{option} {text}: a chance per action is from 0 to 1")
    return Rate(per_action=value)


def _refuse_second(option: str, text: str, key: object, given: dict[object, str]) -> None:
    if key in given:
        raise InputError(f"--{option} {text}: given before, as {given[key]}")
    given[key] = text


def _number(text: str) -> float | None:
    """A finite number that is not negative."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value >= 0 else None
