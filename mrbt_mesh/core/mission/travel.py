"""Where local tasks happen, and how long robots are on their way there.

A mission without places has no `Travel`, and nothing of it costs that anything.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import isqrt

from mrbt_mesh.core.scheduling.problem import Objective

MICRO = 1_000_000
MAX_PLACES = 1_000
MAX_MS = 1_000_000_000
MAX_HORIZON = 1_000
MAX_OVERTAKING = 1_000
# The most places between which one robot publishes travel times.
MAX_TIMED_PLACES = 100


@dataclass(frozen=True, slots=True)
class Travel:
    """Places, and the ways between them.

    `places`: place -> its coordinates in millionths of a unit of the map, None where only `ways_ms`
    lead. `speeds`: robot type -> millionths of a unit per second. `ways_ms`: (from, to) -> how long
    the way takes, for robots of all types; it goes before coordinates and speeds, and holds both
    ways unless the other is given. `at`: ground local task -> the place where it happens; others
    happen anywhere. `start`: robot -> the place where it is at first, of each that can do one of
    `at`. `has_way_back`: whether robots return there in the end. `horizon`: how many tasks a
    schedule looks ahead, at most. `overtaking`: how often later jobs of its priority, or later
    attempts of loops, may go before a task.
    """

    places: Mapping[str, tuple[int, int] | None]
    at: Mapping[str, str]
    start: Mapping[str, str]
    speeds: Mapping[str, int] = field(default_factory=dict)
    ways_ms: Mapping[tuple[str, str], int] = field(default_factory=dict)
    objective: Objective = Objective.MAKESPAN
    has_way_back: bool = False
    horizon: int = 100
    overtaking: int = 5
    _tables: dict[str, Sequence[Sequence[int]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def way_ms(self, robot_type: str, origin: str, goal: str) -> int:
        """How long a robot of this type needs from one place to another.

        Raises KeyError for a way that no robot of this type needs.
        """
        if origin == goal:
            return 0
        listed_ms = self.ways_ms.get((origin, goal), self.ways_ms.get((goal, origin)))
        if listed_ms is not None:
            return listed_ms
        start, end = self.places[origin], self.places[goal]
        if start is None or end is None:
            raise KeyError(f"no way from {origin} to {goal}")
        distance = isqrt((start[0] - end[0]) ** 2 + (start[1] - end[1]) ** 2)
        return -(-1_000 * distance // self.speeds[robot_type])

    def with_places(self, at: Mapping[str, str]) -> Travel:
        """The same ways, with these places of local tasks."""
        found = replace(self, at=at)
        object.__setattr__(found, "_tables", self._tables)
        return found

    def table(self, robot_type: str) -> Sequence[Sequence[int]]:
        """`way_ms` of all places, in the order of `places`: from each to each.

        `MAX_MS` for a way that no robot of this type needs.
        """
        found = self._tables.get(robot_type)
        if found is None:
            names = list(self.places)
            found = [[self._way_or_max_ms(robot_type, a, b) for b in names] for a in names]
            self._tables[robot_type] = found
        return found

    def changed_table(
        self, robot_type: str, places: Sequence[str], ways_ms: Sequence[Sequence[int | None]]
    ) -> Sequence[Sequence[int]]:
        """`table` with other ways between some places, from each to each; None: unchanged."""
        found, names = [*self.table(robot_type)], list(self.places)
        numbers = [names.index(place) for place in places]
        for origin, times_ms in zip(numbers, ways_ms, strict=True):
            row = [*found[origin]]
            for goal, ms in zip(numbers, times_ms, strict=True):
                if ms is not None and goal != origin:
                    row[goal] = ms
            found[origin] = row
        return found

    def _way_or_max_ms(self, robot_type: str, origin: str, goal: str) -> int:
        try:
            return self.way_ms(robot_type, origin, goal)
        except KeyError:
            return MAX_MS

    def way_problem(self, robot_type: str, start: str, goals: Collection[str]) -> str:
        """Why a robot that starts here cannot have tasks at these places; empty if it can."""
        found = [self.places[place] for place in {start, *goals}]
        known = [at for at in found if at is not None]
        if robot_type in self.speeds and len(known) == len(found):
            x, y = zip(*known, strict=True)
            across = isqrt((max(x) - min(x)) ** 2 + (max(y) - min(y)) ** 2)
            if 1_000 * across > MAX_MS * self.speeds[robot_type]:
                most = f"needs more than {MAX_MS // 1_000} s between the places"
                return f"{robot_type} {most}; give it a speed in units of the map per second"
            return ""
        # All lead back as well.
        for origin, goal in combinations(sorted({start, *goals}), 2):
            try:
                self.way_ms(robot_type, origin, goal)
            except KeyError:
                way = f"{robot_type} has no way from {origin} to {goal}; add it to ways"
                is_mapped = None not in (self.places[origin], self.places[goal])
                missing = "" if is_mapped else "both places coordinates, and "
                return f"{way}, or give {missing}{robot_type} a speed"
        return ""


def ways_between(
    table: Sequence[Sequence[int]], origin: int, goal: int, left_ms: int
) -> Sequence[int]:
    """The ways to all places from where `left_ms` of a way are left, as `Travel.table` has them.

    As on a plane (Stewart's theorem), but no longer than by way of its ends.
    """
    whole_ms = table[origin][goal]
    done_ms, found = whole_ms - left_ms, list[int]()
    if done_ms <= 0:
        return table[origin]
    for back_ms, on_ms in zip(table[origin], table[goal], strict=True):
        square = (left_ms * back_ms**2 + done_ms * on_ms**2) // whole_ms - left_ms * done_ms
        found.append(min(isqrt(max(0, square)), done_ms + back_ms, left_ms + on_ms))
    return found
