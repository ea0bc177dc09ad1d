"""How coalitions carry out a task: what plans make of it, and which facts follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mrbt_mesh.features.exclusive.fields import CoalitionFields

if TYPE_CHECKING:
    from mrbt_mesh.core.bt.evaluation import Request
    from mrbt_mesh.core.facts.store import Fact, Incarnation
    from mrbt_mesh.core.facts.team_facts import TeamFacts
    from mrbt_mesh.core.mission.mission import GlobalTask
    from mrbt_mesh.core.planning.capabilities import Capabilities, Worker
    from mrbt_mesh.core.planning.demands import Group


@dataclass(frozen=True, slots=True)
class CoalitionPolicy(CoalitionFields):
    """The policy of such a task. Its modules are loaded when they are needed first."""

    def demands(
        self,
        facts: TeamFacts,
        request: Request,
        capabilities: Capabilities,
        able: Sequence[Mapping[str, int]],
        asked: str,
    ) -> Group:
        from mrbt_mesh.features.exclusive.demands import demands

        return demands(facts, request, self, capabilities, able, asked)

    def obstacle(
        self, facts: TeamFacts, request: Request, group: Group, team: Mapping[str, Worker]
    ) -> str:
        from mrbt_mesh.features.exclusive.demands import obstacle

        return obstacle(facts, request, self, group, team) if self.exclusive else ""

    def lead(
        self,
        facts: TeamFacts,
        task: GlobalTask,
        activation: str,
        alive: Mapping[str, Incarnation],
    ) -> tuple[str, int]:
        from mrbt_mesh.features.exclusive.coalitions import (
            coalition_at_work,
            coalitions_of,
            grantors,
        )

        token = coalition_at_work(facts, task, activation, alive)
        number = coalitions_of(facts, activation).round_number(grantors(facts), token)
        return token.leader if token is not None else "", number

    def latches(
        self,
        facts: TeamFacts,
        task: GlobalTask,
        activation: str,
        alive: Mapping[str, Incarnation],
        me: str,
    ) -> list[Fact]:
        from mrbt_mesh.core.facts.records import LATCH
        from mrbt_mesh.features.exclusive.coalitions import newly_broken
        from mrbt_mesh.features.exclusive.kinds import BROKEN

        broken = newly_broken(facts, task, activation, alive, me)
        return [(f"{BROKEN}/{activation}/{token}", LATCH) for token in broken]
