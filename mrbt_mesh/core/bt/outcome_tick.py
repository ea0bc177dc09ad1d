"""What a tree reads in the tick in which an action returns.

An action that sets conditions does so before it returns. In that tick, which goes through the tree
from the left, what stands left of the action has read them before, and what stands right of it
reads them afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.bt.evaluation import EvaluationFacts, OverlaidFacts
from mrbt_mesh.core.bt.tree import Status


class OutcomeTick(OverlaidFacts):
    """Facts before an outcome, with that outcome and the conditions that are set with it.

    `status`: that of the outcome's activation from then on. `conditions`: the values from then on,
    by the names that the tree reads; the tree reads them once it has read that status. To be
    evaluated once, from scratch. `EvaluationFacts`.
    """

    def __init__(
        self,
        facts: EvaluationFacts,
        activation: str,
        status: Status,
        conditions: Mapping[str, bool],
    ) -> None:
        super().__init__(facts)
        self.conditions = conditions
        self._activation = activation
        self._status = status
        self._has_returned = False

    def condition(self, name: str) -> bool:
        """Whether the condition holds, at this moment of the tick."""
        value = self.conditions.get(name) if self._has_returned else None
        return super().condition(name) if value is None else value

    def task_status(self, subject: str, activation: str) -> Status:
        """The status of an action."""
        if activation != self._activation:
            return super().task_status(subject, activation)
        self._has_returned = True
        return self._status
