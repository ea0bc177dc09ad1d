"""What this robot works on: its claim, and the action that carries it out.

A claim is `claimed` while the team comes to agree and `running` once the action is started; in
between it is `ready` while its coalition forms. An action that is no longer wanted is
cancelled; if it finishes all the same, its outcome is recorded.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from mrbt_mesh.core.agent.effects import CancelAction, Effect, StartAction
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MAX_TREE_NODES
from mrbt_mesh.core.planning.plan import Line


@dataclass(frozen=True, slots=True)
class Ticket:
    """An action that was started and has not ended; `coalition` is its coalition's token."""

    number: int
    activation: str
    global_task: str
    local_task: str
    coalition: str = ""


def _subject(line: Line | None) -> tuple[str, str, str, int] | None:
    """What makes a line another one: a coalition that has ended is begun anew."""
    return (line.activation, line.local_task, line.leader, line.round) if line else None


class Work:
    """At most one claim, and at most one action (which may still be stopping)."""

    def __init__(self) -> None:
        self.line: Line | None = None
        self.line_since_us = 0
        self.claim: Claim | None = None
        self.action: Ticket | None = None
        self.progress = 0
        # Of the nodes of the tree that is the action, if one is.
        self.tree_statuses = b""
        # How the local task ended that was assigned last, until T_Li has been ticked with it.
        self.ended: tuple[str, Status] | None = None
        self._stopping = False
        self._tickets = 0

    @property
    def is_idle(self) -> bool:
        """Whether no action runs, not even one that is being cancelled."""
        return self.action is None

    @property
    def is_waiting(self) -> bool:
        """Whether there is a claim whose action could start once the team agrees."""
        return self.claim is not None and self.claim.phase < Phase.RUNNING and self.is_idle

    def follow(self, line: Line | None, stamp: int, now_us: int) -> tuple[bool, list[Effect]]:
        """Follow this robot's line of a new plan: (whether the claim changed, effects)."""
        wanted, held = _subject(line), _subject(self.line)
        self.line = line
        if wanted == held:
            return False, []
        self.line_since_us = now_us
        effects = self._cancel()
        if line is None:
            changed = self.claim is not None
            self.claim = None
            return changed, effects
        self.claim = Claim(line.activation, line.global_task, line.local_task, Phase.CLAIMED, stamp)
        return True, effects

    def get_ready(self) -> None:
        """The team agrees: wait for the coalition; call it only if `is_waiting`."""
        assert self.claim is not None
        self.claim = replace(self.claim, phase=Phase.READY)

    def start(
        self,
        partners: tuple[str, ...],
        performance: int,
        incarnation: Incarnation,
        coalition: str,
    ) -> StartAction:
        """Begin the action of the claim; call it only if `is_waiting`."""
        assert self.claim is not None
        claim = self.claim
        self._tickets += 1
        self._stopping = False
        self.progress, self.tree_statuses = 0, b""
        self.action = Ticket(
            self._tickets, claim.activation, claim.global_task, claim.local_task, coalition
        )
        self.claim = replace(claim, phase=Phase.RUNNING, coalition=coalition)
        return StartAction(
            self._tickets,
            claim.activation,
            claim.global_task,
            claim.local_task,
            partners,
            performance,
            incarnation,
            coalition,
        )

    def progressed(self, number: int, percent: int) -> None:
        """How far the action is."""
        if self.action is not None and self.action.number == number:
            self.progress = max(0, min(100, percent))

    def tree_ticked(self, number: int, statuses: bytes) -> None:
        """What the nodes of the action's tree have come to."""
        if self.action is not None and self.action.number == number and not self._stopping:
            self.tree_statuses = statuses if len(statuses) <= MAX_TREE_NODES else b""

    def finish(self, number: int, success: bool) -> Ticket | None:
        """An action ended by itself; returns it, or None if it is not known."""
        action = self.action
        if action is None or action.number != number:
            return None
        self.action = None
        self.progress, self.tree_statuses = 0, b""
        if self.claim is not None and not self._stopping:
            self.claim = None
            self.line = None
            self.ended = action.local_task, Status.SUCCESS if success else Status.FAILURE
        self._stopping = False
        return action

    def stopped(self, number: int) -> None:
        """A cancelled action runs no more."""
        if self.action is not None and self.action.number == number:
            self.action = None
            self._stopping = False

    def drop(self) -> list[Effect]:
        """Give everything up: leaving, or taking a new incarnation."""
        self.line = None
        self.claim = None
        return self._cancel()

    def _cancel(self) -> list[Effect]:
        if self.action is None or self._stopping:
            return []
        self._stopping = True
        self.progress, self.tree_statuses = 0, b""
        return [CancelAction(self.action.number)]
