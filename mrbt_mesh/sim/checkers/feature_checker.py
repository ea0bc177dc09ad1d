"""Checkers of invariants that features promise, and the call of all of them."""

from __future__ import annotations

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.feature import features
from mrbt_mesh.sim.checkers.findings import RunFindings


class FeatureChecker:
    """A checker of the invariants that a feature promises; it does nothing as it is here."""

    def __init__(self, run: RunFindings) -> None:
        self.run = run

    def started(self, agent: AgentView, start: StartAction) -> None:
        """A robot has begun an action of the team at its place."""

    def claimed(self, agent: AgentView, claim: Claim) -> None:
        """A robot has claimed another activation."""


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
