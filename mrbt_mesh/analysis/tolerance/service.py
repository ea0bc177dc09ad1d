"""Services: what a team must be able to do at the same time, and whether it can.

A service is one global task, or several that the fault-free plan serves together. It is feasible if
every need finds its nu robots, no robot twice: the paper's problem (2) is consistent, which the
runtime decides in `core.consistency`. Exclusive tasks also need a living majority of the robots
that the mission names.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.mission.mission import GlobalTask, Mission, majority
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.consistency import Consistency
from mrbt_mesh.core.planning.demands import Demand

# One minor fault: a robot loses this entry of its capabilities.
Capability: TypeAlias = tuple[str, str]
# A robot (major fault) or a capability of it (minor fault).
Fault: TypeAlias = str | Capability
# What every living robot can do.
ANYBODY = "a living robot"


@dataclass(frozen=True)
class JointNeed:
    """`count` robots at the same time, each able to do `local_task`.

    `entries`: robot -> the capabilities that it must still have.
    """

    local_task: str
    count: int
    entries: Mapping[str, tuple[Capability, ...]]


@dataclass(frozen=True)
class Service:
    """Needs that must be met at the same time; `name` is for messages.

    `is_bound`: the needs are bound to robots that did something before, which no others can
    replace.
    """

    name: str
    tasks: tuple[str, ...]
    needs: tuple[JointNeed, ...]
    exclusive: bool
    is_bound: bool = False

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
    """Return what a robot must keep to do a local task; empty if it never could do it.

    Losing the capability for the ground local task, or the one for its type, ends it.
    """
    names = dict.fromkeys((local_task, type_name(local_task)))
    return tuple((robot, name) for name in names if name in capabilities)


def service(mission: Mission, tasks: tuple[GlobalTask, ...], name: str) -> Service:
    """Return the service of performing these global tasks at the same time.

    Needs that the same robots meet with the same capabilities are merged; a need for no robots is
    omitted.
    """
    counts: dict[str, int] = {}
    for task in tasks:
        for need in filter(lambda need: need.min_robots, task.needs):
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
    return Service(name, ids, tuple(needs), any(task.at_most_once for task in tasks))


def somebody(mission: Mission) -> Service:
    """Return the service of any living robot: a team without robots does nothing, even if nothing
    needs to be done.
    """
    anyone = JointNeed(ANYBODY, 1, dict.fromkeys(sorted(mission.robots), ()))
    return Service("anything, as there is no robot", (), (anyone,), False)


def merged(needs: Sequence[JointNeed], is_major: bool = False) -> tuple[JointNeed, ...]:
    """Return the needs, merging those met by the same capabilities (or robots, if `is_major`)."""
    found: dict[tuple[object, ...], JointNeed] = {}
    for need in needs:
        key = tuple(sorted(need.entries if is_major else need.entries.items()))
        known = found.get(key)
        found[key] = replace(known, count=known.count + need.count) if known else need
    return tuple(found.values())


@dataclass(frozen=True)
class FaultyTeam:
    """The robots of a mission, some of which are dead (major) or have lost capabilities (minor)."""

    mission: Mission
    faults: frozenset[Fault] = frozenset()

    @cached_property
    def alive(self) -> tuple[str, ...]:
        """The living robots, sorted."""
        return tuple(robot for robot in sorted(self.mission.robots) if robot not in self.faults)

    def with_faults(self, *faults: Fault) -> FaultyTeam:
        """Return the same team with these additional faults."""
        return FaultyTeam(self.mission, self.faults | set(faults))

    def able(self, need: JointNeed) -> dict[str, int]:
        """Return the robots that can meet a need."""
        return {
            robot: 0
            for robot, entries in sorted(need.entries.items())
            if robot not in self.faults and not any(entry in self.faults for entry in entries)
        }

    def has_majority(self) -> bool:
        """Return whether exclusive tasks can get their grants."""
        return len(self.alive) >= majority(self.mission.robots)

    def seating(self, needs: Sequence[JointNeed]) -> dict[str, int] | None:
        """Return a way to meet all needs at the same time: robot -> index of its need.

        None: impossible.
        """
        together = Consistency(self.alive)
        for index, need in enumerate(needs):
            if not together.keep(index, [self.demand(need)], {}):
                return None
        return together.matched

    def demand(self, need: JointNeed) -> Demand:
        """Return a need as the runtime's demand."""
        request = Request(0, need.local_task, "")
        able = self.able(need)
        return Demand(request, need.local_task, need.count, need.count, need.count, (), able)

    def can_meet(self, needs: Sequence[JointNeed]) -> bool:
        """Return whether all needs can be met at the same time, no robot twice."""
        return self.seating(needs) is not None

    def relies_on(self, wanted: Service) -> frozenset[Fault] | None:
        """Return faults of which at least one is necessary to make a service infeasible.

        None if it is infeasible already. These are the robots and capabilities used by one way to
        perform it, which remains possible without any of these faults.
        """
        seated = self.seating(wanted.needs)
        if seated is None or (wanted.exclusive and not self.has_majority()):
            return None
        used: set[Fault] = set(self.alive) if wanted.exclusive else set(seated)
        for robot, index in seated.items():
            used.update(wanted.needs[index].entries[robot])
        return frozenset(used)

    def is_feasible(self, wanted: Service) -> bool:
        """Return whether this team can perform all of a service at the same time."""
        return self.relies_on(wanted) is not None

    def overasked(self, needs: Sequence[JointNeed]) -> list[int]:
        """Return the indices of a minimal part of infeasible needs that is infeasible by itself.

        It asks for more robots than can do any of it (Hall's theorem).
        """
        part = list(range(len(needs)))
        for index in list(part):
            fewer = [other for other in part if other != index]
            if not self.can_meet([needs[other] for other in fewer]):
                part = fewer
        return part

    def slack(self, wanted: Service) -> int:
        """Return how many robots, whichever they are, a service can lose.

        -1 if it is infeasible.
        """
        if not self.is_feasible(wanted):
            return -1
        least = self.tightest(wanted.needs)[0]
        if wanted.exclusive:
            least = min(least, len(self.alive) - majority(self.mission.robots))
        return least

    def tightest(self, needs: Sequence[JointNeed]) -> tuple[int, list[int]]:
        """Return how many robots feasible needs can lose, and the needs that cannot lose one more.

        By Hall's theorem, s robots can go if each need alone could ask for s more.
        """
        least, tight = len(self.alive) + 1, [0]
        for index, need in enumerate(needs):
            extra = 0
            while extra < least:
                asked = list(needs)
                asked[index] = replace(need, count=need.count + extra + 1)
                if not self.can_meet(asked):
                    least, tight = extra, self.overasked(asked)
                    break
                extra += 1
        return least, tight


def robot_faults(mission: Mission) -> list[Fault]:
    """Return every single major fault."""
    return [*sorted(mission.robots)]


def capability_faults(mission: Mission) -> list[Fault]:
    """Return every single minor fault, of level 1."""
    return [
        (robot, name)
        for robot in sorted(mission.robots)
        for name in sorted(mission.robots[robot].capabilities)
    ]
