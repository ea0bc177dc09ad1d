"""Where robots physically are, and how long their ways take: the world outlives its processes."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import anyio

from mrbt_mesh.core.facts.records import Claim, NoClaim
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.runtime.program import functions_of
from mrbt_mesh.sim.world.clock import MICRO, current_gate
from mrbt_mesh.sim.world.setup import Setup

_Legs = Sequence["Leg"]


@dataclass(frozen=True, slots=True)
class Leg:
    """A way that takes `way_ms`, of which `done_ms` are over."""

    origin: str
    goal: str
    way_ms: float
    done_ms: float = 0.0

    @property
    def left_ms(self) -> float:
        return self.way_ms - self.done_ms

    def turned(self) -> Leg:
        """The same spot, on the way back."""
        return Leg(self.goal, self.origin, self.way_ms, self.left_ms)


def legs_to(travel: Travel, table: Sequence[Sequence[int]], spot: Leg, goal: str) -> list[Leg]:
    """The way from a spot between two places, by a table of all ways: turning round or going on,
    the shorter.
    """
    found, names = [], list(travel.places)
    for first in (spot, spot.turned()):
        way_ms = table[names.index(first.goal)][names.index(goal)]
        found.append([first, Leg(first.goal, goal, way_ms)])
    return min(found, key=duration_ms)


def duration_ms(legs: _Legs) -> float:
    """How long all of them take from here."""
    return sum(leg.left_ms for leg in legs)


def spot_after(legs: _Legs, passed_ms: float) -> Leg:
    """Where a robot is after so long on these legs."""
    for leg in legs[:-1]:
        if passed_ms < leg.left_ms:
            return replace(leg, done_ms=leg.done_ms + passed_ms)
        passed_ms -= leg.left_ms
    last = legs[-1]
    return replace(last, done_ms=min(last.way_ms, last.done_ms + passed_ms))


class Driving:
    """Drives robots whose programs do not, and draws how much longer or shorter ways and works take
    than the mission says: up to `Setup.noise_permille`, always the same for the same.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._mission: Mission = setup.mission
        self._spots: dict[str, Leg] = {}
        travel = setup.mission.travel
        if travel is None or functions_of(setup.program).travel is not None:
            return
        places = dict(travel.start)
        for entry in setup.begin.facts if setup.begin is not None else ():
            if isinstance(entry.record, Claim | NoClaim) and entry.record.place:
                places[entry.author] = entry.record.place
        for robot, place in places.items():
            self._spots[robot] = Leg(place, place, 0.0)

    def revised(self, mission: Mission) -> None:
        """A revision of the mission is in force."""
        self._mission = mission

    async def drive(self, task: TaskContext, place: str, table: Sequence[Sequence[int]]) -> None:
        """A robot goes to a place in virtual time, by its table of ways; where it is cancelled, it
        stops.
        """
        robot, travel = task.robot, self._mission.travel
        assert travel is not None
        spot = self._spots.get(robot, Leg(place, place, 0.0))
        legs = legs_to(travel, table, spot, place)
        stretched = self.stretch(robot, f"{spot.origin}>{place}") / task.simulation.speed
        gate = current_gate.get()
        ahead_s = gate.ahead_us / MICRO if gate is not None else 0.0
        begun_s = anyio.current_time() - ahead_s
        try:
            await anyio.sleep(duration_ms(legs) / 1_000 * stretched)
        except BaseException:
            passed_ms = (anyio.current_time() - begun_s) * 1_000 / stretched
            self._spots[robot] = spot_after(legs, passed_ms)
            raise
        self._spots[robot] = Leg(place, place, 0.0)

    def is_at(self, robot: str, place: str) -> bool:
        """Whether a robot physically is there; one that its program drives always is."""
        spot = self._spots.get(robot)
        return spot is None or spot.origin == spot.goal == place

    def stretch(self, robot: str, what: str) -> float:
        """By which factor this way or work of a robot takes longer."""
        most = self._setup.noise_permille
        if not most:
            return 1.0
        text = f"{self._setup.seed}/noise/{robot}/{what}"
        drawn = int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")
        return (1_000 - most + drawn % (2 * most + 1)) / 1_000
