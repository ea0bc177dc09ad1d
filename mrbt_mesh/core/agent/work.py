"""What this robot works on: its claim, and the action that carries it out.

A claim is `claimed` while the team comes to agree and `running` once the action is started; in
between it is `ready` while its coalition forms. An action that is no longer needed is cancelled; if
it finishes all the same, its outcome is recorded.
"""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.core.agent.effects import CancelAction, Effect, StartAction
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MAX_TREE_NODES
from mrbt_mesh.core.planning.plan import RobotAssignment


def _subject(assignment: RobotAssignment | None) -> tuple[str, str, str, int] | None:
    """What distinguishes one assignment from another: a coalition that has ended is formed anew."""
    if assignment is None:
        return None
    return assignment.activation, assignment.local_task, assignment.leader, assignment.round


class Work:
    """At most one claim, and at most one action (which may still be stopping).

    `action`: as it was started, until it has ended. `tree_statuses`: of the nodes of the tree that
    carries it out, if one does. `ended`: the local task that was assigned last and its outcome,
    until T_Li has been ticked with it.
    """

    def __init__(self) -> None:
        self.assignment: RobotAssignment | None = None
        self.assigned_us = 0
        self.claim: Claim | None = None
        self.action: StartAction | None = None
        self.progress = 0
        self.tree_statuses = b""
        self.ended: tuple[str, Status] | None = None
        self._stopping = False
        self._tickets = 0

    @property
    def is_waiting(self) -> bool:
        """Whether there is a claim whose action could start once the team agrees."""
        is_started = self.claim is None or self.claim.phase is Phase.RUNNING
        return not is_started and self.action is None

    def follow(
        self, assignment: RobotAssignment | None, stamp: int, now_us: int
    ) -> tuple[bool, list[Effect]]:
        """Follow this robot's assignment in a new plan: (whether the claim changed, effects)."""
        wanted, held = _subject(assignment), _subject(self.assignment)
        self.assignment = assignment
        if wanted == held:
            return False, []
        self.assigned_us = now_us
        before, self.claim = self.claim, None
        if assignment is not None:
            names = assignment.activation, assignment.global_task, assignment.local_task
            self.claim = Claim(*names, Phase.CLAIMED, stamp)
        return self.claim is not before, self._cancel()

    def get_ready(self, claim: Claim) -> Claim:
        """The team agrees: wait for the coalition."""
        self.claim = replace(claim, phase=Phase.READY)
        return self.claim

    def start(
        self,
        claim: Claim,
        partners: tuple[str, ...],
        performance: int,
        incarnation: Incarnation,
        coalition: str,
    ) -> StartAction:
        """Begin the action of the claim."""
        self._tickets += 1
        self._stopping = False
        self._clear_progress()
        names = claim.activation, claim.global_task, claim.local_task
        self.claim = replace(claim, phase=Phase.RUNNING, coalition=coalition)
        self.action = StartAction(
            self._tickets, *names, partners, performance, incarnation, coalition
        )
        return self.action

    def resume(
        self,
        claim: Claim | None,
        assignment: RobotAssignment | None,
        partners: tuple[str, ...],
        incarnation: Incarnation,
        now_us: int,
    ) -> list[Effect]:
        """Go on with what was assigned and claimed before; an action that ran is started again."""
        self.claim, self.assigned_us, value = claim, now_us, 0
        if assignment is not None and claim is not None:
            held = (claim.activation, claim.local_task)
            if held == (assignment.activation, assignment.local_task):
                self.assignment, value = assignment, assignment.performance
        if claim is None or claim.phase is not Phase.RUNNING:
            return []
        return [self.start(claim, partners, value, incarnation, claim.coalition)]

    def progressed(self, number: int, percent: int) -> None:
        """How far the action is."""
        if self.action is not None and self.action.ticket == number:
            self.progress = max(0, min(100, percent))

    def tree_ticked(self, number: int, statuses: bytes) -> None:
        """The nodes of the action's tree have these statuses."""
        if self.action is not None and self.action.ticket == number and not self._stopping:
            self.tree_statuses = statuses if len(statuses) <= MAX_TREE_NODES else b""

    def finish(self, number: int, success: bool) -> StartAction | None:
        """An action ended by itself; returns it, or None if it is not known."""
        action = self.action
        if action is None or action.ticket != number:
            return None
        self.action = None
        self._clear_progress()
        if self.claim is not None and not self._stopping:
            self.claim = None
            self.assignment = None
            self.ended = action.local_task, Status.SUCCESS if success else Status.FAILURE
        self._stopping = False
        return action

    def stopped(self, number: int) -> None:
        """A cancelled action no longer runs."""
        if self.action is not None and self.action.ticket == number:
            self.action = None
            self._stopping = False

    def drop(self) -> list[Effect]:
        """Give everything up: leaving, or taking a new incarnation."""
        self.assignment = None
        self.claim = None
        return self._cancel()

    def _cancel(self) -> list[Effect]:
        if self.action is None or self._stopping:
            return []
        self._stopping = True
        self._clear_progress()
        return [CancelAction(self.action.ticket)]

    def _clear_progress(self) -> None:
        self.progress, self.tree_statuses = 0, b""
