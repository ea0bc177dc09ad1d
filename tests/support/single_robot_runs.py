"""Runs of a tree, a single robot's or a team's, by what its actions declare."""

from __future__ import annotations

import random
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field

from mrbt_mesh.analysis.lift.effects import Declarations
from mrbt_mesh.core.bt.tree import NodeSpec, Status
from tests.support.build import World
from tests.support.single_robot_trees import REST, VARIABLES

MOST_ACTIONS = 60


@dataclass
class Field:
    """The effects of actions. A written value depends on its action and the values that it read."""

    declared: Declarations
    seed: int
    start: Mapping[str, bool]

    def __post_init__(self) -> None:
        self.rest: dict[str, int] = dict.fromkeys(REST, 0)

    def begin(self, name: str, world: World) -> tuple[bool, dict[str, int]]:
        """How the action will end, by what it finds: success, and what it will write."""
        does = self.declared[name]
        able = all(world.facts.condition(v) is value for v, value in does.requires.items())
        unlucky = does.may_fail and random.Random(f"{self.seed}/{name}").random() < 0.5
        read = sorted((x, self.rest[x]) for x in does.reads)
        written = {x: zlib.crc32(repr((name, x, read)).encode()) for x in does.writes}
        return able and not unlucky, written

    def end(
        self, activation: str, name: str, begun: tuple[bool, dict[str, int]], world: World
    ) -> None:
        success, written = begun
        if success:
            self.rest |= written
            for variable, value in self.declared[name].effects.items():
                if world.mission.knows_condition(variable):
                    world.set(variable, value)
        world.outcome(activation, success)

    def state(self, world: World) -> dict[str, object]:
        known = [v for v in VARIABLES if world.mission.knows_condition(v)]
        return {v: world.facts.condition(v) for v in known} | self.rest


@dataclass(frozen=True)
class Ended:
    """How a run ended, and the most actions that were going on at the same time."""

    status: Status
    state: dict[str, object]
    at_once: int = field(compare=False)


def run(
    spec: NodeSpec, declared: Declarations, start: Mapping[str, bool], seed: int, robots: int
) -> Ended | None:
    """One run with `robots` robots; None if it does not end."""
    world = World(spec, [name for name, value in start.items() if value])
    place, source = Field(declared, seed, start), random.Random(f"run/{seed}/{robots}")
    running: dict[str, tuple[str, tuple[bool, dict[str, int]]]] = {}
    at_once = 0
    for _ in range(MOST_ACTIONS * 4):
        asked = {r.activation: r.subject for r in world.tick().requests}
        running = {a: begun for a, begun in running.items() if a in asked}
        waiting = [a for a in asked if a not in running]
        if world.status is not Status.RUNNING:
            return Ended(world.status, place.state(world), at_once)
        if waiting and len(running) < robots and (not running or source.random() < 0.7):
            activation = waiting[0] if robots == 1 else source.choice(waiting)
            running[activation] = asked[activation], place.begin(asked[activation], world)
            at_once = max(at_once, len(running))
        else:
            activation = source.choice(sorted(running))
            name, begun = running.pop(activation)
            place.end(activation, name, begun, world)
    return None
