"""Starting under a lease: the coalition of an exclusive task needs leases from a majority.

Contains both sides: this robot as a member that needs leases, and as a grantor. An agent has this
part only if its mission has exclusive tasks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mrbt_mesh.core.agent.operator_desk import FieldRule
from mrbt_mesh.core.agent.start_policy import Clearance, Situation, StartPolicy
from mrbt_mesh.core.facts.records import LATCH, Claim, Phase
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.feature import Kit
from mrbt_mesh.core.membership.wire import Heartbeat, Request, RequestAnswer
from mrbt_mesh.core.mission.mission import GlobalTask
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.features.exclusive.coalition_start import CoalitionStart
from mrbt_mesh.features.exclusive.coalitions import coalitions_of, grantors
from mrbt_mesh.features.exclusive.decisions import decision_rules
from mrbt_mesh.features.exclusive.kinds import BROKEN, CLEARED, DOUBT
from mrbt_mesh.features.exclusive.leases import Leases
from mrbt_mesh.features.exclusive.records import CoalitionId


class LeasedStart(CoalitionStart):
    """Starts with the other members, and only while a majority leases the activation to them."""

    def __init__(self, kit: Kit, now_us: int) -> None:
        context = kit.context
        super().__init__(context)
        self._planner = kit.planner
        timing, durability = context.config.timing, context.durability
        self.leases = Leases(
            context.me, context.facts, timing, now_us, durability, context.peer_clocks
        )
        # The journal's number of this robot's ready claim, to know if it is on disk.
        self._ready = 0

    def start_policy(self, task: GlobalTask) -> StartPolicy | None:
        return self if task.at_most_once else None

    def rules(self) -> Mapping[str, FieldRule]:
        return decision_rules(self._context)

    def first_life(self) -> None:
        self.leases.grantor.end_silence()

    def resume(self, now_us: int) -> None:
        """Continue the earlier work with its leases, and the grants."""
        self.leases.grantor.end_silence()
        claim = self._context.work.claim
        if claim is not None and claim.party and self._is_exclusive(claim):
            token = CoalitionId.parse(claim.party)
            self.leases.holder.resume(claim.activation, token, now_us)

    # -- the member ---------------------------------------------------------------------------

    @property
    def needs_ready(self) -> bool:
        """True if the journal can be written. Otherwise the robot does not get ready."""
        return self._context.durability.may_promise

    def note_ready(self, number: int) -> None:
        """Note that the robot has promised, under this number, that it is ready."""
        self._ready = number

    def clear(self, situation: Situation) -> Clearance | None:
        """As in a coalition, but only once this robot's claim is on disk to survive a crash."""
        durability = self._context.durability
        if not durability.may_promise or not durability.is_on_disk(self._ready):
            return None
        return super().clear(situation)

    def may_work(self, activation: str, token: CoalitionId, now_us: int) -> bool:
        """True if this robot holds the leases of a majority."""
        return self.leases.holder.is_held(activation, token, now_us)

    def steps_until_us(self) -> int | None:
        """Until when the program may go on with this robot's claim; None if it is not exclusive.

        In a large team the robots of a majority are not all neighbours: only the leases count.
        """
        context, claim = self._context, self._context.work.claim
        if claim is None or claim.phase is not Phase.RUNNING or not self._is_exclusive(claim):
            return None
        holder, held_us = self.leases.holder, self.leases.holder.held_until_us()
        if not context.config.timing.all_are_neighbours(len(context.mission.robots)):
            return held_us
        return min(held_us, holder.heard_until_us(context.me))

    def given_up(self, claim: Claim) -> list[Fact]:
        """The facts that a dropped claim requires. A claim that was begun leaves the activation in
        doubt; a leader that never began frees its leases.
        """
        context, activation = self._context, claim.activation
        if claim.phase is Phase.RUNNING:
            doubts = coalitions_of(context.facts, activation).doubts
            if context.me in doubts.get(CoalitionId.parse(claim.party), ()):
                return []
            return [(f"{DOUBT}/{activation}/{claim.party}", LATCH)]
        token = CoalitionId(claim.since, context.me, *context.replica.incarnation)
        if self.leases.holder.requested == (activation, str(token)):
            return [(f"{CLEARED}/{activation}/{token}", LATCH)]
        return []

    def is_bound(self) -> bool:
        return not self.leases.is_idle

    def next_us(self, now_us: int) -> int | None:
        return self.leases.next_deadline_us()

    def request(self) -> Request | None:
        return self.leases.holder.requested

    def answers(self) -> Sequence[RequestAnswer]:
        return self.leases.grantor.grants()

    def synced(self) -> None:
        self.leases.take_own_answers()

    def perform(self, plan: Plan, now_us: int) -> None:
        """Request the leases that this robot's claim needs, and no others."""
        holder, work = self.leases.holder, self._context.work
        assignment, claim = work.assignment, work.claim
        if claim is not None and self._is_exclusive(claim):
            token = self.token(assignment, claim) if assignment is not None else None
            holder.request(claim.activation, token)
        elif holder.requested is not None:
            holder.request("", None)

    def _is_exclusive(self, claim: Claim) -> bool:
        task = self._context.facts.task_of(claim.activation)
        return task is not None and task.at_most_once

    def follow(self, now_us: int) -> None:
        """Expire the leases that this robot has granted, and stop if its own have expired."""
        context, claim = self._context, self._context.work.claim
        writes = self.leases.grantor.expire(now_us)
        if writes:
            context.write(writes, now_us)
        if claim is None or claim.phase is not Phase.RUNNING or not self._is_exclusive(claim):
            return
        token = CoalitionId.parse(claim.party)
        found = coalitions_of(context.facts, claim.activation)
        ended = token in found.broken or context.me in found.doubts.get(token, ())
        if not ended and not self.may_work(claim.activation, token, now_us):
            context.log("warning", "grants_ran_out", global_task=claim.global_task)
            names = (DOUBT, BROKEN)
            context.write([(f"{name}/{claim.activation}/{token}", LATCH) for name in names], now_us)

    # -- the grantor --------------------------------------------------------------------------

    def heard(self, robot: str, beat: Heartbeat, now_us: int) -> None:
        """Process a heartbeat, which may request a lease or answer this robot's own request.

        A request repeats in every heartbeat. While a plan is made, facts must not change.
        """
        has_leases = beat.request is not None or beat.answers
        if has_leases and self._planner.awaited is None:
            grants = self.leases.receive_heartbeat(robot, beat, now_us, self._may_grant)
            self._promise(grants, now_us)

    def sent(self, number: int, now_us: int) -> None:
        """Process this robot's own heartbeat, a request or renewal that it answers itself first."""
        self._promise(self.leases.heartbeat_sent(number, now_us, self._may_grant), now_us)

    def _promise(self, grants: list[Fact], now_us: int) -> None:
        if grants:
            self.leases.grantor.written(self._context.promise(grants, now_us))

    def _may_grant(self, activation: str, token: CoalitionId) -> bool:
        """True if, in this robot's own view, the activation belongs to this coalition."""
        context, facts, plan = self._context, self._context.facts, self._planner.plan
        if context.joining is not None or context.is_leaving or plan is None:
            return False
        if coalitions_of(facts, activation).unended(grantors(facts))[:1] == [token]:
            return True
        assignment, known = plan.assignments.get(token.leader), facts.members.get(token.leader)
        if assignment is None or known is None:
            return False
        is_assigned = (assignment.activation, assignment.leader) == (activation, token.leader)
        return is_assigned and known.incarnation == (token.counter, token.nonce)
