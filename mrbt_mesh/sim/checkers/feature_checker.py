"""Checkers of invariants that features promise, and the call of all of them."""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.core.agent.effects import Effect, StartAction
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.feature import features
from mrbt_mesh.sim.checkers.findings import RunFindings
from mrbt_mesh.sim.world.journal import Changes
from mrbt_mesh.sim.world.process import SimProcess


class FeatureChecker:
    """A checker of the invariants that a feature promises; it does nothing as it is here."""

    def __init__(self, run: RunFindings) -> None:
        self.run = run

    def synced(self, process: SimProcess, changes: Changes) -> None:
        """A process has put this on its disk."""

    def handling(self, process: SimProcess, agent: AgentView, event: Input) -> None:
        """An agent is about to handle an input, with which its action may end."""

    def started(self, agent: AgentView, start: StartAction) -> None:
        """A robot has begun an action of the team at its place."""

    def claimed(self, agent: AgentView, claim: Claim) -> None:
        """A robot has claimed another activation."""

    def handled(self, process: SimProcess, effects: Sequence[Effect]) -> None:
        """An agent has handled an input, with these effects."""

    def stepped(self, agent: AgentView) -> None:
        """An agent has handled an input, with effects or without."""

    @property
    def wait_us(self) -> int:
        """How long robots may wait, and write nothing, for what the feature has them wait for."""
        return 0

    @property
    def done_twice(self) -> int:
        """How often something was done again that must not be."""
        return 0


class FeatureCheckers(FeatureChecker):
    """Those of all features."""

    def __init__(self, run: RunFindings) -> None:
        super().__init__(run)
        self._all = [checker for each in features() for checker in each.checkers(run)]

    def started(self, agent: AgentView, start: StartAction) -> None:
        for checker in self._all:
            checker.started(agent, start)

    def claimed(self, agent: AgentView, claim: Claim) -> None:
        for checker in self._all:
            checker.claimed(agent, claim)

    def synced(self, process: SimProcess, changes: Changes) -> None:
        for checker in self._all:
            checker.synced(process, changes)

    def handling(self, process: SimProcess, agent: AgentView, event: Input) -> None:
        for checker in self._all:
            checker.handling(process, agent, event)

    def handled(self, process: SimProcess, effects: Sequence[Effect]) -> None:
        for checker in self._all:
            checker.handled(process, effects)

    def stepped(self, agent: AgentView) -> None:
        for checker in self._all:
            checker.stepped(agent)

    @property
    def wait_us(self) -> int:
        return max((checker.wait_us for checker in self._all), default=0)

    @property
    def done_twice(self) -> int:
        return sum(checker.done_twice for checker in self._all)
