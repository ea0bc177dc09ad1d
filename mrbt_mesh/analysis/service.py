"""Services: what a team must be able to do at one time, and whether it can.

A service is one global task, or several that the fault-free plan serves together. It is feasible
when every need finds its nu robots, no robot twice: the paper's problem (2) is consistent, which
the runtime decides in `core.demand.Consistency`. Exclusive tasks also need a living majority of
the robots that the mission names.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

from mrbt_mesh.core.coalition import majority
from mrbt_mesh.core.demand import Consistency, Demand
from mrbt_mesh.core.evaluate import Request
from mrbt_mesh.core.mission import GlobalTask, Mission, type_name

# One minor fault: a robot loses this entry of its capabilities.
Capability: TypeAlias = tuple[str, str]
# A robot (major fault) or a capability of it (minor fault).
Fault: TypeAlias = str | Capability


@dataclass(frozen=True)
class JointNeed:
    """`count` robots at one time, each able to do `local_task`.

    `entries`: robot -> those of its capabilities that it must have kept for it.
    """

    local_task: str
    count: int
    entries: Mapping[str, tuple[Capability, ...]]


@dataclass(frozen=True)
class Service:
    """Needs that must be met at one time; `name` is for people."""

    name: str
    tasks: tuple[str, ...]
    needs: tuple[JointNeed, ...]
    exclusive: bool

    @cached_property
    def touched_by(self) -> frozenset[Fault]:
        """The single faults that can make a difference to it."""
        found: set[Fault] = set()
        for need in self.needs:
            for robot, entries in need.entries.items():
                found |= {robot, *entries}
        return frozenset(found)


def entries_of(
    capabilities: Collection[str], robot: str, local_task: str
) -> tuple[Capability, ...]:
    """What a robot must keep to do a local task; empty if it never could.

    Losing either a capability for the ground local task or the one for its type ends it.
    """
    names = dict.fromkeys((local_task, type_name(local_task)))
    return tuple((robot, name) for name in names if name in capabilities)


def service(mission: Mission, tasks: tuple[GlobalTask, ...], name: str) -> Service:
    """The service of doing these global tasks at one time.

    Needs that the same robots meet with the same capabilities become one.
    """
    counts: dict[str, int] = {}
    for task in tasks:
        for need in task.needs:
            counts[need.local_task] = counts.get(need.local_task, 0) + need.min_robots
    needs = []
    for local_task, count in counts.items():
        entries = {
            robot.id: found
            for robot in mission.robots.values()
            if (found := entries_of(robot.capabilities, robot.id, local_task))
        }
        needs.append(JointNeed(local_task, count, entries))
    ids = tuple(task.id for task in tasks)
    return Service(name, ids, tuple(needs), any(task.exclusive for task in tasks))


def merged(needs: Collection[JointNeed]) -> tuple[JointNeed, ...]:
    """The same needs, those that the same capabilities meet taken together."""
    found: dict[tuple[tuple[Capability, ...], ...], JointNeed] = {}
    for need in needs:
        key = tuple(entries for _, entries in sorted(need.entries.items()))
        known = found.get(key)
        count = need.count + (known.count if known else 0)
        found[key] = JointNeed(known.local_task if known else need.local_task, count, need.entries)
    return tuple(found.values())


@dataclass(frozen=True)
class Team:
    """The robots of a mission, some of which are dead (major) or have lost capabilities (minor)."""

    mission: Mission
    faults: frozenset[Fault] = frozenset()

    @cached_property
    def alive(self) -> tuple[str, ...]:
        """Living robots, sorted."""
        return tuple(robot for robot in sorted(self.mission.robots) if robot not in self.faults)

    def with_faults(self, *faults: Fault) -> Team:
        """The same team with these faults as well."""
        return Team(self.mission, self.faults | set(faults))

    def able(self, need: JointNeed) -> dict[str, int]:
        """Robots that can meet a need."""
        return {
            robot: 0
            for robot, entries in sorted(need.entries.items())
            if robot not in self.faults and not any(entry in self.faults for entry in entries)
        }

    def has_majority(self) -> bool:
        """Whether exclusive tasks find their grants."""
        return len(self.alive) >= majority(self.mission.robots)

    def can_meet(self, needs: Collection[JointNeed]) -> bool:
        """Whether all needs can be met at one time, no robot twice."""
        return Consistency(self.alive).keep(0, self.demands(needs), {})

    def demands(self, needs: Collection[JointNeed]) -> list[Demand]:
        """The needs as the runtime's demands."""
        return [_demand(need, need.count, self.able(need)) for need in needs]

    def is_feasible(self, wanted: Service) -> bool:
        """Whether this team can do all of a service at one time."""
        if wanted.exclusive and not self.has_majority():
            return False
        return self.can_meet(wanted.needs)

    def slack(self, wanted: Service) -> int:
        """How many robots, whichever they are, a service can lose; -1 if it is infeasible.

        By Hall's theorem, s robots can go if each need alone could ask for s more.
        """
        if not self.is_feasible(wanted):
            return -1
        least = len(self.alive)
        if wanted.exclusive:
            least = len(self.alive) - majority(self.mission.robots)
        for raised in wanted.needs:
            extra = 0
            while extra < least and self.can_meet(
                [
                    JointNeed(n.local_task, n.count + (extra + 1) * (n is raised), n.entries)
                    for n in wanted.needs
                ]
            ):
                extra += 1
            least = extra
        return least


def _demand(need: JointNeed, count: int, able: Mapping[str, int]) -> Demand:
    request = Request(0, need.local_task, "")
    return Demand(request, need.local_task, count, count, count, (), able)


def robot_faults(mission: Mission) -> list[Fault]:
    """Every single major fault."""
    return list(sorted(mission.robots))


def capability_faults(mission: Mission) -> list[Fault]:
    """Every single minor fault, of level 1."""
    return [
        (robot, name)
        for robot in sorted(mission.robots)
        for name in sorted(mission.robots[robot].capabilities)
    ]
