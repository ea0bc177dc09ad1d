"""What this robot works on: its claim, and the action that carries it out.

A claim is `claimed` while the team comes to agree and `running` once the action is started. In
between it is `travelling` on the way to the place of its local task, and `ready` while its party
forms. The way is an action of its own. An action that is no longer needed is cancelled; if it
finishes nevertheless, its outcome is recorded, or the robot counts as at the way's place.
"""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.core.agent.effects import CancelAction, Effect, StartAction
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MAX_TREE_NODES
from mrbt_mesh.core.planning.plan import RobotAssignment


def _subject(assignment: RobotAssignment | None) -> tuple[object, ...] | None:
    """What distinguishes assignments. Includes the round, as an ended party is formed anew."""
    x = assignment
    return None if x is None else (x.activation, x.local_task, x.leader, x.round, x.values)


class Work:
    """At most one claim, and at most one action (which may still be stopping).

    `action`: as it was started, until it has ended. `running_since_us`: since when it has been
    running; None without one, on a way, and while it stops. `tree_statuses`: of the nodes of the
    tree that carries it out, if one does. `ended`: the local task that was assigned last and its
    outcome, until T_Li has been ticked with it. `place`: the last place where it arrived, empty
    before the first arrival; `has_arrived`: the arrival is not written yet. `is_between`: it has
    set out from a place, or may have in an earlier incarnation, and has not arrived anywhere since.
    """

    def __init__(self) -> None:
        self.assignment: RobotAssignment | None = None
        self.assigned_us = 0
        self.claim: Claim | None = None
        self.action: StartAction | None = None
        self.running_since_us: int | None = None
        self.progress = 0
        self.tree_statuses = b""
        self.ended: tuple[str, Status] | None = None
        self.place = ""
        self.has_arrived = False
        self.is_between = False
        self._stopping = False
        self._tickets = 0

    @property
    def is_waiting(self) -> bool:
        """True if there is a claim whose action could start once the team agrees."""
        is_started = self.claim is None or self.claim.phase is Phase.RUNNING
        return not is_started and self.action is None

    def follow(
        self, assignment: RobotAssignment | None, stamp: int, place: str, now_us: int
    ) -> tuple[bool, list[Effect]]:
        """Follow this robot's assignment in a new plan. Returns (whether the claim changed,
        effects).

        `place`: the place of a new claim.
        """
        wanted, held = _subject(assignment), _subject(self.assignment)
        self.assignment = assignment
        if wanted == held or self._is_on_its_way_to(assignment):
            return False, []
        self.assigned_us = now_us
        before, self.claim = self.claim, None
        if assignment is not None:
            names = assignment.activation, assignment.global_task, assignment.local_task
            self.claim = Claim(*names, Phase.CLAIMED, stamp, place=place)
        return self.claim is not before, self._cancel()

    def _is_on_its_way_to(self, assignment: RobotAssignment | None) -> bool:
        """True if the robot already travels for this assignment, perhaps under another leader."""
        claim = self.claim
        return (
            claim is not None
            and claim.phase is Phase.TRAVELLING
            and assignment is not None
            and (claim.activation, claim.local_task)
            == (assignment.activation, assignment.local_task)
        )

    def get_ready(self, claim: Claim) -> Claim:
        """Wait for the party, as the team agrees. Returns the changed claim."""
        self.claim = replace(claim, phase=Phase.READY)
        return self.claim

    def start(
        self,
        claim: Claim,
        partners: tuple[str, ...],
        performance: int,
        incarnation: Incarnation,
        now_us: int,
        party: str = "",
        travel_to: str = "",
    ) -> StartAction:
        """Begin the action of the claim, or the way to its place."""
        self._tickets += 1
        self._stopping = False
        self._clear_progress()
        self.running_since_us = None if travel_to else now_us
        names = claim.activation, claim.global_task, claim.local_task
        phase = Phase.TRAVELLING if travel_to else Phase.RUNNING
        self.is_between = self.is_between or bool(travel_to)
        self.claim = replace(claim, phase=phase, party=party)
        values = self.assignment.values if self.assignment is not None else ()
        self.action = StartAction(
            self._tickets, *names, partners, performance, incarnation, party, travel_to, values
        )
        return self.action

    def start_alone(
        self,
        activation: str,
        local_task: str,
        performance: int,
        incarnation: Incarnation,
        now_us: int,
    ) -> StartAction:
        """Begin an action that nobody requested. It has no claim, and no outcome for others."""
        self._tickets += 1
        self._stopping = False
        self._clear_progress()
        self.running_since_us = now_us
        self.action = StartAction(
            self._tickets, activation, "", local_task, (), performance, incarnation
        )
        return self.action

    def arrive(self, action: StartAction, now_us: int) -> None:
        """End a way at its place, even if it was being cancelled, and wait there for agreement.

        The claim from there is written in the next step.
        """
        self.action, self._stopping = None, False
        self.place, self.has_arrived, self.is_between = action.travel_to, True, False
        self.assigned_us = now_us
        if self.claim is not None:
            self.claim = replace(self.claim, phase=Phase.CLAIMED, place=self.place)

    def resume(
        self,
        claim: Claim | None,
        assignment: RobotAssignment | None,
        partners: tuple[str, ...],
        incarnation: Incarnation,
        now_us: int,
        travel_to: str,
    ) -> list[Effect]:
        """Continue with the earlier assignment and claim. An action that ran is started again.

        `travel_to`: the place that the robot was travelling to, empty if none.
        """
        self.claim, self.assigned_us, value = claim, now_us, 0
        if assignment is not None and claim is not None:
            held = (claim.activation, claim.local_task)
            if held == (assignment.activation, assignment.local_task):
                self.assignment, value = assignment, assignment.performance
        if claim is None or not (travel_to or claim.phase is Phase.RUNNING):
            return []
        names = claim.party, travel_to
        return [self.start(claim, partners, value, incarnation, now_us, *names)]

    def progressed(self, number: int, percent: int) -> None:
        """Note the progress of the action."""
        if self.action is not None and self.action.ticket == number:
            self.progress = max(0, min(100, percent))

    def tree_ticked(self, number: int, statuses: bytes) -> None:
        """Note the statuses of the nodes of the action's tree."""
        if self.action is not None and self.action.ticket == number and not self._stopping:
            self.tree_statuses = statuses if len(statuses) <= MAX_TREE_NODES else b""

    def finish(self, number: int, success: bool) -> StartAction | None:
        """End an action that ended by itself. Returns it, or None if it is not known."""
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

    @property
    def is_stopping(self) -> bool:
        """True if the action was cancelled and has not ended."""
        return self._stopping

    def stopped(self, number: int) -> None:
        """Note that a cancelled action no longer runs."""
        if self.action is not None and self.action.ticket == number:
            self.action = None
            self._stopping = False

    def drop(self) -> list[Effect]:
        """Give up claim and action, to leave or to take a new incarnation. Returns the effects."""
        self.assignment = None
        self.claim = None
        self.has_arrived = False
        return self._cancel()

    def _cancel(self) -> list[Effect]:
        if self.action is None or self._stopping:
            return []
        self._stopping = True
        self._clear_progress()
        return [CancelAction(self.action.ticket)]

    def _clear_progress(self) -> None:
        self.progress, self.tree_statuses, self.running_since_us = 0, b"", None
