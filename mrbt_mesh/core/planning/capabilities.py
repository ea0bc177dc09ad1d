"""Who of the team can do what, and how well."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from mrbt_mesh.core.facts.records import Member
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.mission.names import type_name

# Of so many local tasks is kept who can do them. Jobs bring new ones all the time.
MOST_LOCAL_TASKS = 2_048


@dataclass(frozen=True, slots=True)
class Worker:
    """A robot that the plan may use: alive, joined, not leaving."""

    id: str
    member: Member
    incarnation: Incarnation


def workers(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> dict[str, Worker]:
    """The robots that a plan may use, sorted by id."""
    found = {}
    for robot in sorted(alive):
        member, incarnation = facts.members.get(robot, (None, None))
        if member is not None and incarnation == alive[robot] and not member.is_leaving:
            found[robot] = Worker(robot, member, alive[robot])
    return found


class RobotMasks:
    """Sets of robots as bit masks. Robots that have no bit are left out."""

    def __init__(self, robots: Iterable[str]) -> None:
        self.robots = tuple(robots)
        self._bits = {robot: 1 << number for number, robot in enumerate(self.robots)}
        # By the identity of a set: that set, which keeps the identity from being used again.
        self._remembered: dict[int, tuple[Collection[str], int]] = {}

    def of(self, robots: Iterable[str]) -> int:
        """The mask of some robots."""
        remembered = self._remembered.get(id(robots))
        if remembered is not None:
            return remembered[1]
        mask, bits = 0, self._bits
        for robot in robots:
            mask |= bits.get(robot, 0)
        return mask

    def remember(self, robots: Collection[str], mask: int) -> None:
        """Keep the mask of a set that never changes."""
        self._remembered[id(robots)] = robots, mask

    def forget(self, robots: Collection[str]) -> None:
        """The inverse of `remember`."""
        del self._remembered[id(robots)]


class Capabilities:
    """What the robots of a team can do: p(i, l) of the paper, in micro-units.

    What it returns must not be changed: the capabilities of the next team share it. `masks` has
    bits for the robots of the team.
    """

    def __init__(self, team: dict[str, Worker], masks: RobotMasks | None = None) -> None:
        self.team = team
        self.masks = masks or RobotMasks(team)
        self._able: dict[str, dict[str, int]] = {}

    @cached_property
    def _having(self) -> dict[str, list[str]]:
        """Robots by the name of a capability, which is that of a local task or of a type."""
        found: dict[str, list[str]] = {}
        for robot, worker in self.team.items():
            for name in worker.member.capabilities:
                found.setdefault(name, []).append(robot)
        return found

    def able(self, local_task: str) -> Mapping[str, int]:
        """The robots that can do it, sorted by id, and how well."""
        found = self._able.get(local_task)
        if found is None:
            having = self._having.get(local_task, [])
            kind = type_name(local_task)
            if kind != local_task:
                having = sorted({*having, *self._having.get(kind, ())})
            values = ((r, capability(self.team[r].member, local_task)) for r in having)
            found = {robot: value for robot, value in values if value is not None}
            self._keep(local_task, found, self.masks.of(found))
        return found

    def _keep(self, local_task: str, able: dict[str, int], mask: int) -> None:
        self.masks.remember(able, mask)
        self._able[local_task] = able
        if len(self._able) > MOST_LOCAL_TASKS:
            self.masks.forget(self._able.pop(next(iter(self._able))))

    def after(self, team: dict[str, Worker]) -> Capabilities:
        """Those of the team as it is now: only robots that differ are looked up again."""
        gone = [r for r, worker in self.team.items() if not _is_same(worker, team.get(r))]
        come = [r for r, worker in team.items() if not _is_same(worker, self.team.get(r))]
        if not gone and not come:
            return self
        known = set(self.masks.robots)
        masks = RobotMasks([*self.masks.robots, *(r for r in come if r not in known)])
        lost, found = masks.of(gone), Capabilities(team, masks)
        for local_task, before in self._able.items():
            able, mask = before, self.masks.of(before)
            if mask & lost:
                able = before.copy()
                for robot in gone:
                    able.pop(robot, None)
            values = ((r, capability(team[r].member, local_task)) for r in come)
            added = {robot: value for robot, value in values if value is not None}
            if added:
                able = dict(sorted((able | added).items()))
            found._keep(local_task, able, mask & ~lost | masks.of(added))
        return found


def _is_same(worker: Worker, other: Worker | None) -> bool:
    """Whether nothing that was looked up differs: records are never changed, only replaced."""
    return (
        other is not None
        and worker.member is other.member
        and worker.incarnation == other.incarnation
    )


def capabilities_of(
    facts: TeamFacts, alive: Mapping[str, Incarnation], before: Capabilities | None = None
) -> Capabilities:
    """Those of the robots that a plan may use; `before`: those of the team's last plan."""
    team = workers(facts, alive)
    return Capabilities(team) if before is None else before.after(team)
