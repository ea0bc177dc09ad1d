"""Where local tasks happen, and how long robots are on their way there.

A mission without places has no `Travel`, and nothing of it costs that anything.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isqrt
from typing import Any

from mrbt_mesh.core.scheduling.problem import Objective

MICRO = 1_000_000
MAX_PLACES = 1_000
MAX_MS = 1_000_000_000
MAX_HORIZON = 1_000


@dataclass(frozen=True, slots=True)
class Travel:
    """Places, and the ways between them.

    `places`: place -> its coordinates in millionths of a unit of the map. `speeds`: robot type ->
    millionths of a unit per second. `ways_ms`: (from, to) -> how long the way takes, for robots of
    all types; it goes before coordinates and speeds, and holds both ways unless the other is given.
    `at`: ground local task -> the place where it happens; others happen anywhere. `start`: robot ->
    the place where it is at first. `has_way_back`: whether robots return there in the end.
    `horizon`: how many tasks a schedule looks ahead, at most.
    """

    places: Mapping[str, tuple[int, int]]
    at: Mapping[str, str]
    start: Mapping[str, str]
    speeds: Mapping[str, int] = field(default_factory=dict)
    ways_ms: Mapping[tuple[str, str], int] = field(default_factory=dict)
    objective: Objective = Objective.MAKESPAN
    has_way_back: bool = False
    horizon: int = 100
    _tables: dict[str, Sequence[Sequence[int]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def way_ms(self, robot_type: str, origin: str, goal: str) -> int:
        """How long a robot of this type needs from one place to another."""
        if origin == goal:
            return 0
        for way in ((origin, goal), (goal, origin)):
            if way in self.ways_ms:
                return self.ways_ms[way]
        (x1, y1), (x2, y2) = self.places[origin], self.places[goal]
        distance = isqrt((x1 - x2) ** 2 + (y1 - y2) ** 2)
        return -(-1_000 * distance // self.speeds[robot_type])

    def table(self, robot_type: str) -> Sequence[Sequence[int]]:
        """`way_ms` of all places, in the order of `places`: from each to each."""
        found = self._tables.get(robot_type)
        if found is None:
            names = list(self.places)
            found = [[self.way_ms(robot_type, a, b) for b in names] for a in names]
            self._tables[robot_type] = found
        return found

    def to_json(self) -> dict[str, Any]:
        """Plain data; `from_json` takes it back."""
        return {
            "places": {name: list(at) for name, at in sorted(self.places.items())},
            "at": dict(sorted(self.at.items())),
            "start": dict(sorted(self.start.items())),
            "speeds": dict(sorted(self.speeds.items())),
            "ways_ms": [[*way, ms] for way, ms in sorted(self.ways_ms.items())],
            "objective": str(self.objective),
            "has_way_back": self.has_way_back,
            "horizon": self.horizon,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Travel:
        """The inverse; raises KeyError, TypeError or ValueError for anything else."""
        return cls(
            {name: (x, y) for name, (x, y) in data["places"].items()},
            data["at"],
            data["start"],
            data["speeds"],
            {(origin, goal): ms for origin, goal, ms in data["ways_ms"]},
            Objective(data["objective"]),
            data["has_way_back"],
            data["horizon"],
        )
