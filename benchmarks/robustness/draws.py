"""The experiment's settings and draws: who can do what, and how long each robot lives.

Everything is drawn beforehand from a seed, so that all teams and bounds get the same luck.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

ROOMS = 4
# Actions 0..3 open rooms, 4..7 move packages.
ACTIONS = 2 * ROOMS
NAMES = (
    *(f"open_room_{room + 1}" for room in range(ROOMS)),
    *(f"move_package_{package + 1}" for package in range(ROOMS)),
)


def before(action: int) -> tuple[int, ...]:
    """The actions that come before: a package needs its own room open and the next one."""
    return () if action < ROOMS else (action - ROOMS, (action - ROOMS + 1) % ROOMS)


@dataclass(frozen=True, order=True)
class Cell:
    """One setting: `robots` robots, homogeneity in percent, chance of death per action in percent.

    `published` is MRBTP's success rate, in percent.
    """

    robots: int
    homogeneity: int
    fault: int
    published: float

    @property
    def able(self) -> int:
        """How many robots are given each capability."""
        return math.ceil(self.robots * self.homogeneity / 100)


# Source: MRBTP (AAAI 2025), its table of success rates under faults.
_FOUR = {
    10: (41.4, 59.8, 80.4, 94.0),
    30: (5.8, 12.0, 27.2, 59.4),
    50: (0.4, 2.0, 2.8, 10.4),
}
_EIGHT = {10: 99.8, 30: 92.2, 50: 44.6}
CELLS: tuple[Cell, ...] = (
    *(
        Cell(4, homogeneity, fault, published)
        for fault, row in _FOUR.items()
        for homogeneity, published in zip((25, 50, 75, 100), row, strict=True)
    ),
    *(Cell(8, 100, fault, published) for fault, published in _EIGHT.items()),
)


@dataclass(frozen=True)
class Draw:
    """`able[a]` are the robots capable of action a; robot i dies at its `lives[i]`-th completion.

    `seed` names the draw; the same seed gives the same capabilities at any rate of faults.
    """

    seed: int
    able: tuple[frozenset[int], ...]
    lives: tuple[int, ...]

    def capabilities(self, robot: int) -> list[int]:
        """The actions that a robot can do."""
        return [action for action in range(ACTIONS) if robot in self.able[action]]


def draw(cell: Cell, seed: int) -> Draw:
    """The draw of one seed."""
    chance = random.Random(f"robustness/{seed}/{cell.robots}/{cell.homogeneity}")
    robots = range(cell.robots)
    while True:
        able = tuple(frozenset(chance.sample(robots, cell.able)) for _ in range(ACTIONS))
        if frozenset().union(*able) == frozenset(robots):
            break
    chance = random.Random(f"robustness/{seed}/{cell.robots}/{cell.homogeneity}/{cell.fault}")
    return Draw(seed, able, tuple(_life(chance, cell.fault) for _ in robots))


def _life(chance: random.Random, fault: int) -> int:
    actions = 1
    while chance.randrange(100) >= fault:
        actions += 1
    return actions
