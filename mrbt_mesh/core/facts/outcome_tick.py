"""What T_G reads in the tick in which an action returns.

An action that sets conditions does so before it returns. In that tick, which goes through the tree
from the left, what stands left of the action has read them before, and what stands right of it
reads them afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.conditions import own_name


class OutcomeTick:
    """The team's facts with an outcome but without the conditions that are set with it.

    These are read once the status of the outcome's activation has been. To be evaluated once, from
    scratch. `EvaluationFacts`.
    """

    def __init__(self, facts: TeamFacts, activation: str, conditions: Mapping[str, bool]) -> None:
        self._facts = facts
        self._activation = activation
        self._conditions = conditions
        self._has_returned = False

    @property
    def run(self) -> str:
        return self._facts.run

    def condition(self, name: str) -> bool:
        """Whether the condition holds, at this moment of the tick."""
        if not self._has_returned:
            return self._facts.condition(name)
        if name not in self._facts.mission.own:
            return self._after(name)
        return any(self._after(own_name(name, robot)) for robot in self._facts.mission.robots)

    def _after(self, name: str) -> bool:
        value = self._conditions.get(name)
        return self._facts.condition(name) if value is None else value

    def task_status(self, subject: str, activation: str) -> Status:
        """The status of a global task."""
        self._has_returned = self._has_returned or activation == self._activation
        return self._facts.task_status(subject, activation)

    def turns(self, name: str, value: bool) -> int:
        return self._facts.turns(name, value)

    def attempts_used(self, activation: str) -> int:
        return self._facts.attempts_used(activation)

    def has_expired(self, activation: str) -> bool:
        return self._facts.has_expired(activation)

    def child_result(self, activation: str, position: int) -> Status | None:
        return self._facts.child_result(activation, position)
