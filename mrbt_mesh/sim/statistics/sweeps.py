"""What `mrbt estimate` may vary, and how rates and sweeps are written."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.sim.estimate import Point
from mrbt_mesh.sim.statistics.team_sizes import resized
from mrbt_mesh.sim.world.failures import EVERYBODY, FailureModel, Rate, losable

FAULT_RATE, MINOR_RATE, FAILURE_RATE = "fault-rate", "minor-rate", "failure-rate"
MAJOR, MINOR, ROBOTS = "major", "minor", "robots"
NAMES = (FAULT_RATE, MINOR_RATE, FAILURE_RATE, MAJOR, MINOR, ROBOTS)
MAX_VALUES = 1_000
_UNITS = ("action", "hour")
_RANGE = re.compile(r"([0-9.e+-]+):([0-9.e+-]+)(?::([0-9.e+-]+))?")


class SweepError(InputError):
    """A rate or a sweep that cannot be used; the message says what would be right."""


def parse_rates(option: str, texts: Sequence[str], mission: Mission) -> dict[str, Rate]:
    """Robot, type or EVERYBODY -> rate, of texts like `0.1`, `0.1/action`, `A1:2/hour`."""
    rates: dict[str, Rate] = {}
    said: dict[object, str] = {}
    types = {robot.type for robot in mission.robots.values()}
    for text in texts:
        who, _, number = text.rpartition(":")
        if who and who not in mission.robots and who not in types:
            known = ", ".join([*sorted(mission.robots), *sorted(types)])
            raise SweepError(f"--{option} {text}: no robot or type {who!r} ({known})")
        unit = "hour" if number.endswith("/hour") else "action"
        _refuse_second(option, text, (who, unit), said)
        before, more = rates.get(who, Rate()), parse_rate(option, number)
        rates[who] = Rate(more.per_action or before.per_action, more.per_hour or before.per_hour)
    return rates


def _refuse_second(option: str, text: str, key: object, said: dict[object, str]) -> None:
    if key in said:
        raise SweepError(f"--{option} {text}: given before, as {said[key]}")
    said[key] = text


def parse_rate(option: str, text: str) -> Rate:
    """`0.1` and `0.1/action`: a chance per action; `2/hour`: so many times per hour."""
    number, _, unit = text.partition("/")
    value = _number(number)
    if value is None or value < 0 or (unit or "action") not in _UNITS:
        raise SweepError(f"--{option} {text}: expected e.g. 0.1/action or 2/hour")
    if unit == "hour":
        return Rate(per_hour=value)
    if value > 1:
        raise SweepError(f"--{option} {text}: a chance per action is from 0 to 1")
    return Rate(per_action=value)


def parse_chances(option: str, texts: Sequence[str], mission: Mission) -> dict[str, float]:
    """Local task or EVERYBODY -> chance, of texts like `0.1` or `move_frame:0.2`."""
    chances: dict[str, float] = {}
    said: dict[object, str] = {}
    for text in texts:
        name, _, number = text.rpartition(":")
        value = _number(number)
        if name and name not in mission.local_tasks:
            known = ", ".join(sorted(mission.local_tasks))
            raise SweepError(f"--{option} {text}: no local task {name!r} ({known})")
        if value is None or not 0 <= value <= 1:
            raise SweepError(f"--{option} {text}: a chance is from 0 to 1")
        _refuse_second(option, text, name, said)
        chances[name] = value
    return chances


def parse_sweep(text: str) -> tuple[str, list[str]]:
    """(name, values) of `major=0,1,2`, `fault-rate=0:0.5:0.1/action` or `robots=1,2,4`."""
    name, equals, values = text.partition("=")
    if name not in NAMES or not equals:
        raise SweepError(f"--sweep {text}: expected NAME=VALUES, NAME one of {', '.join(NAMES)}")
    numbers, slash, unit = values.partition("/")
    match = _RANGE.fullmatch(numbers)
    if match:
        found = _range(text, *match.groups())
    else:
        found = [part.strip() for part in numbers.split(",")]
    return name, [f"{number}{slash}{unit}" for number in found]


def _range(text: str, first: str, last: str, step: str | None) -> list[str]:
    low, high, by = _number(first), _number(last), _number(step or "1")
    if low is None or high is None or not by or by < 0 or high < low:
        raise SweepError(f"--sweep {text}: expected FIRST:LAST or FIRST:LAST:STEP, e.g. 0:0.5:0.1")
    count = math.floor((high - low) / by + 1e-9) + 1
    if count > MAX_VALUES:
        raise SweepError(f"--sweep {text}: {count} values, at most {MAX_VALUES}")
    return [f"{low + by * k:.10g}" for k in range(count)]


def points_of(
    mission: Mission, base: FailureModel, robots: int | None, sweeps: Sequence[str]
) -> tuple[Point, ...]:
    """The points of up to two sweeps, the first one varying fastest.

    Left out are those with more faults than their team can suffer. Raises SweepError.
    """
    parsed = [parse_sweep(text) for text in sweeps]
    names = [name for name, _ in parsed]
    if len(parsed) > 2 or len(set(names)) < len(names):
        raise SweepError("--sweep: at most two, of different names")
    points, problem = [], ""
    for values in product(*(values for _, values in reversed(parsed))):
        point = Point(base, robots, tuple(zip(names, reversed(values), strict=True)))
        for name, value in point.values:
            point = _with(mission, point, name, value)
        found = _impossible(mission, point)
        problem = problem or found
        if not found:
            points.append(point)
    if not points:
        raise SweepError(problem)
    return tuple(points)


def _impossible(mission: Mission, point: Point) -> str:
    """Why a team cannot suffer that many faults; empty if it can."""
    try:
        team = mission if point.robots is None else resized(mission, point.robots)
    except ValueError as error:
        raise SweepError(f"--robots: {error}") from None
    for option, number, most, what in (
        (MAJOR, point.failures.major_faults, len(team.robots), "robots"),
        (MINOR, point.failures.minor_faults, len(losable(team)), "capabilities"),
    ):
        if number > most:
            return f"--{option} {number}: the team has only {most} {what} to lose"
    return ""


def _with(mission: Mission, point: Point, name: str, value: str) -> Point:
    option, failures = f"sweep {name}", point.failures
    if name in (MAJOR, MINOR, ROBOTS):
        number = int(value) if value.isdigit() else -1
        if number < (name == ROBOTS):
            raise SweepError(f"--{option}={value}: expected a whole number")
        if name == ROBOTS:
            return replace(point, robots=number)
        if name == MAJOR:
            return replace(point, failures=replace(failures, major_faults=number))
        return replace(point, failures=replace(failures, minor_faults=number))
    if name == FAILURE_RATE:
        chances = {**failures.actions, **parse_chances(option, [value], mission)}
        return replace(point, failures=replace(failures, actions=chances))
    before: Mapping[str, Rate] = failures.major if name == FAULT_RATE else failures.minor
    rates = {**before, EVERYBODY: parse_rate(option, value)}
    if name == FAULT_RATE:
        return replace(point, failures=replace(failures, major=rates))
    return replace(point, failures=replace(failures, minor=rates))


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
