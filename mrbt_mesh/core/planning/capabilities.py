"""Who of the team can do what, and how well."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mrbt_mesh.core.facts.records import Member
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.mission.names import type_name


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


class Capabilities:
    """What the robots of a team can do: p(i, l) of the paper, in micro-units."""

    def __init__(self, team: dict[str, Worker]) -> None:
        self.team = team
        self._able: dict[str, dict[str, int]] = {}
        # By the name of a capability, which is that of a local task or of a type of them.
        self._having: dict[str, list[str]] = {}
        for robot, worker in team.items():
            for name in worker.member.capabilities:
                self._having.setdefault(name, []).append(robot)

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
            self._able[local_task] = found
        return found


def capabilities_of(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Capabilities:
    """Those of the robots that a plan may use."""
    return Capabilities(workers(facts, alive))
