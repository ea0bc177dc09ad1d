"""The faults that the mission survives, and the reason: the paper's section VI-B.

Each global task of this mission needs one local task only, and in the worst case they come one
after the other. So the team can do all of them as long as each local task keeps as many capable
robots as the largest nu asks for. The table of what is to spare explains the figures; they
themselves come from the analysis, which knows nothing of this.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from mrbt_mesh.analysis.tolerance.fault_counts import tolerance
from mrbt_mesh.analysis.tolerance.readings import serial
from mrbt_mesh.analysis.tolerance.service import Fault, FaultyTeam, capability_faults, robot_faults
from mrbt_mesh.core.mission.mission import Mission, performance
from mrbt_mesh.core.mission.names import type_name

LIMIT_S = 60.0


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


@dataclass(frozen=True)
class Survived:
    """As `mrbt analyze` has it: how many minor faults at most, all largest sets of robots that
    may be lost, and what is fatal alone: robots, and capabilities as (robot, local task).
    """

    minor: int
    majors: tuple[tuple[str, ...], ...]
    critical: tuple[Fault, ...]


def survived(mission: Mission) -> Survived:
    """Raises ValueError if the team cannot do the mission, or a solver did not come to an end."""
    reading = serial(mission).reading
    minor = tolerance(reading, capability_faults(mission), LIMIT_S)
    major = tolerance(reading, robot_faults(mission), LIMIT_S)
    capabilities, robots = minor.max_tolerated, major.max_tolerated
    if capabilities.value is None or robots.value is None:
        raise ValueError("the team cannot do the mission even without a fault")
    if not capabilities.is_proved or not robots.is_proved:
        raise ValueError(f"{LIMIT_S:g} s are too short to tell how many faults are survived")
    lost = combinations(sorted(mission.robots), robots.value)
    majors = tuple(
        dead for dead in lost if reading.survives(FaultyTeam(mission).with_faults(*dead))
    )
    return Survived(capabilities.value, majors, major.critical + minor.critical)
