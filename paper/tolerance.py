"""How many faults the mission survives, by counting: the paper's section VI-B.

Each global task of this mission needs one local task only, and in the worst case they come one
after the other. So the team can do all of them as long as each local task keeps as many capable
robots as the largest nu asks for.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from mrbt_mesh.core.mission import Mission, performance, type_name


@dataclass(frozen=True)
class Spare:
    """A type of local task: who is capable, and the largest nu of any global task."""

    local_task: str
    capable: tuple[str, ...]
    needed: int

    @property
    def count(self) -> int:
        """How many minor faults of it can be tolerated; each takes it from one robot."""
        return len(self.capable) - self.needed


def spares(mission: Mission) -> list[Spare]:
    """All types of local tasks that are needed; raises ValueError if counting is not enough."""
    needed: dict[str, int] = {}
    for task in mission.global_tasks.values():
        if len(task.needs) != 1:
            raise ValueError(f"{task.id} needs several local tasks at a time")
        (need,) = task.needs
        name = type_name(need.local_task)
        needed[name] = max(needed.get(name, 0), need.min_robots)
    return [
        Spare(
            name,
            tuple(
                robot.id
                for robot in mission.robots.values()
                if performance(robot.capabilities, name) is not None
            ),
            count,
        )
        for name, count in needed.items()
    ]


def tolerated_minor(mission: Mission) -> int:
    """The most minor faults that can be tolerated."""
    return sum(spare.count for spare in spares(mission))


def tolerated_major(mission: Mission) -> tuple[int, list[tuple[str, ...]]]:
    """The most major faults that can be tolerated, and all sets of so many robots."""
    asked = spares(mission)
    for count in range(len(mission.robots), -1, -1):
        survived = [
            dead
            for dead in combinations(sorted(mission.robots), count)
            if all(len(set(s.capable) - set(dead)) >= s.needed for s in asked)
        ]
        if survived:
            return count, survived
    raise ValueError("the team cannot do the mission even without a fault")


def critical(mission: Mission) -> list[Spare]:
    """Local tasks of which no capable robot can be spared."""
    return [spare for spare in spares(mission) if spare.count == 0]
