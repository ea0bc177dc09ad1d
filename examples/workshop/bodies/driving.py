"""Ways over the workshop's floor, as a robot finds them itself: what stands there for good is
known, everything else is what its range finder hits.

Nothing here waits or moves; `robot` does.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from bodies.messages import RANGE_M, Senses

Place: TypeAlias = tuple[float, float]
Box: TypeAlias = tuple[float, float, float, float]  # west, south, east, north
Cell: TypeAlias = tuple[int, int]

CELL_M = 0.2
# What a robot keeps from walls, and from the hits of its range finder.
MARGIN_M, HIT_MARGIN_M = 0.06, 0.12
# Behind a hit there is more, as much as a robot is thick: so far behind it something is as well.
BEHIND_M = (0.0, 0.2, 0.4)
# A hit so near to what is known to stand there is that.
KNOWN_M = 0.12
# Hits farther away than this are of something that will have moved.
NEAR_M = min(3.0, RANGE_M)
# Hits are kept in squares of this size; one is removed once the range finder sees beyond it.
SIGHT_M, GONE_M, REMEMBERED_S = 0.15, 0.3, 30.0
# A robot gets out of where it stands, whatever is beside it.
FREE_M = 0.35
# So far it gets out of where it should not be, since somebody has pushed it there.
ESCAPE_M = 0.8
_STEPS = [(i, j, math.hypot(i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]


@dataclass(frozen=True)
class Site:
    """What is known of the floor: the hall, solid boxes, boxes where nobody may stop."""

    hall: Box
    solids: tuple[Box, ...]
    lanes: tuple[Box, ...]


class Floor:
    """The floor for a robot of one radius."""

    def __init__(self, site: Site, radius_m: float) -> None:
        self._site = site
        self.radius_m = radius_m
        west, south, east, north = site.hall
        self._corner = (west, south)
        self._size = (math.ceil((east - west) / CELL_M), math.ceil((north - south) / CELL_M))
        self._free = frozenset(
            (i, j)
            for i in range(self._size[0])
            for j in range(self._size[1])
            if self.is_free(self._middle((i, j)))
        )

    def is_free(self, place: Place) -> bool:
        """Whether the robot fits there, as far as only what stands there for good is concerned."""
        keep = self.radius_m + MARGIN_M
        west, south, east, north = self._site.hall
        x, y = place
        in_hall = west + keep <= x <= east - keep and south + keep <= y <= north - keep
        return in_hall and all(_to_box(place, box) >= keep for box in self._site.solids)

    def is_known(self, hit: Place) -> bool:
        """Whether what was hit is a wall, or another of the things that stand there for good."""
        west, south, east, north = self._site.hall
        edge = min(hit[0] - west, east - hit[0], hit[1] - south, north - hit[1])
        return edge < KNOWN_M or any(_to_box(hit, box) < KNOWN_M for box in self._site.solids)

    def docks(
        self, target: Place, least_m: float, most_m: float, *, in_lanes: bool = False
    ) -> list[Place]:
        """Where a robot may stand that reaches a target from `least_m` to `most_m` away."""
        found = []
        count = int((most_m - least_m) / 0.1)
        for ring in range(count + 1):
            away_m = least_m + ring * 0.1
            for part in range(24):
                angle = part * math.tau / 24
                place = (
                    target[0] + away_m * math.cos(angle),
                    target[1] + away_m * math.sin(angle),
                )
                in_lane = any(_to_box(place, box) <= 0 for box in self._site.lanes)
                if (in_lanes or not in_lane) and self.is_free(place):
                    found.append(place)
        return found

    def is_taken(self, place: Place, hits: Iterable[Place]) -> bool:
        """Whether something that was hit is in the way there."""
        return any(math.dist(place, hit) < self.radius_m + HIT_MARGIN_M for hit in hits)

    def plan(self, start: Place, goals: Sequence[Place], hits: Sequence[Place]) -> list[Place]:
        """The shortest way to one of the goals, which it ends with; empty: there is none now."""
        ends: dict[Cell, Place] = {}
        for goal in goals:
            if not self.is_taken(goal, hits):
                ends.setdefault(self._cell(goal), goal)
        if not ends:
            return []
        blocked = self._around(hits, start)
        first = self._cell(start)
        came: dict[Cell, Cell | None] = {}
        queue: list[tuple[float, Cell, Cell | None]] = [(0.0, first, None)]
        while queue:
            gone, cell, before = heapq.heappop(queue)
            if cell in came:
                continue
            came[cell] = before
            if cell in ends:
                return [*self._way(came, cell)[1:-1], ends[cell]]
            for i, j, far in _STEPS:
                following = (cell[0] + i, cell[1] + j)
                if following in came or following in blocked:
                    continue
                if following in self._free or following in ends:
                    heapq.heappush(queue, (gone + far, following, cell))
                elif math.dist(self._middle(following), start) < ESCAPE_M:
                    heapq.heappush(queue, (gone + 10 * far, following, cell))
        return []

    def _around(self, hits: Iterable[Place], start: Place) -> set[Cell]:
        """The cells that hits keep a robot out of, but not those where it stands."""
        keep = self.radius_m + HIT_MARGIN_M
        reach = math.ceil(keep / CELL_M)
        blocked = set()
        for hit in hits:
            i, j = self._cell(hit)
            for di in range(-reach, reach + 1):
                for dj in range(-reach, reach + 1):
                    cell = (i + di, j + dj)
                    middle = self._middle(cell)
                    if math.dist(middle, hit) < keep and math.dist(middle, start) > FREE_M:
                        blocked.add(cell)
        return blocked

    def _way(self, came: dict[Cell, Cell | None], end: Cell) -> list[Place]:
        way: list[Place] = []
        cell: Cell | None = end
        while cell is not None:
            way.append(self._middle(cell))
            cell = came[cell]
        return way[::-1]

    def sees(self, start: Place, end: Place, hits: Sequence[Place]) -> bool:
        """Whether the straight way is free."""
        steps = max(1, math.ceil(math.dist(start, end) / (CELL_M / 2)))
        for step in range(1, steps + 1):
            gone = step / steps
            x = start[0] + gone * (end[0] - start[0])
            y = start[1] + gone * (end[1] - start[1])
            if not self.is_free((x, y)) or self.is_taken((x, y), hits):
                return False
        return True

    def aim(self, start: Place, way: Sequence[Place], hits: Sequence[Place]) -> Place:
        """The farthest place of a way, up to a metre on, that one may go to straight."""
        best = way[0]
        for place in way:
            if math.dist(start, place) > 1.0 or not self.sees(start, place, hits):
                break
            best = place
        return best

    def _cell(self, place: Place) -> Cell:
        west, south = self._corner
        return (math.floor((place[0] - west) / CELL_M), math.floor((place[1] - south) / CELL_M))

    def _middle(self, cell: Cell) -> Place:
        west, south = self._corner
        return (west + (cell[0] + 0.5) * CELL_M, south + (cell[1] + 0.5) * CELL_M)


class Sights:
    """Where something stands that is not on the list, as far as a robot has seen.

    What it does not see any more it remembers for a while: else it would turn back to a way that it
    has found blocked as soon as it has turned round.
    """

    def __init__(self, floor: Floor) -> None:
        self._floor = floor
        self._seen: dict[Cell, tuple[Place, float]] = {}

    def look(self, senses: Senses) -> list[Place]:
        """All that is known after this look."""
        here, rays = (senses.x, senses.y), len(senses.ranges_m)
        kept = {}
        for cell, (hit, seen_s) in self._seen.items():
            angle = math.atan2(hit[1] - here[1], hit[0] - here[0]) - senses.heading
            range_m = senses.ranges_m[round(angle * rays / math.tau) % rays]
            is_gone = range_m > math.dist(here, hit) + GONE_M
            if not is_gone and senses.time_s - seen_s < REMEMBERED_S:
                kept[cell] = (hit, seen_s)
        for number, range_m in enumerate(senses.ranges_m):
            if range_m >= NEAR_M:
                continue
            angle = senses.heading + number * math.tau / rays
            cos, sin = math.cos(angle), math.sin(angle)
            if self._floor.is_known((here[0] + range_m * cos, here[1] + range_m * sin)):
                continue
            for behind_m in BEHIND_M:
                away_m = range_m + behind_m
                hit = (here[0] + away_m * cos, here[1] + away_m * sin)
                cell = (math.floor(hit[0] / SIGHT_M), math.floor(hit[1] / SIGHT_M))
                kept[cell] = (hit, senses.time_s)
        self._seen = kept
        return [hit for hit, _ in kept.values()]


def kept_off(
    east: float, north: float, place: Place, hits: Iterable[Place], clear_m: float
) -> Place:
    """A velocity without what of it goes towards something nearer than `clear_m`."""
    for hit in hits:
        away_m = math.dist(place, hit)
        if away_m >= clear_m or away_m == 0:
            continue
        to_x, to_y = (hit[0] - place[0]) / away_m, (hit[1] - place[1]) / away_m
        towards = east * to_x + north * to_y
        if towards > 0:
            east, north = east - towards * to_x, north - towards * to_y
    return east, north


def _to_box(place: Place, box: Box) -> float:
    """How far a place is from a box; 0 within."""
    west, south, east, north = box
    x, y = place
    return math.hypot(max(west - x, 0.0, x - east), max(south - y, 0.0, y - north))
