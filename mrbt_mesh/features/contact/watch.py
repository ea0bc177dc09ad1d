"""A robot's contact with its team or an operator, and its reaction to lost contact.

Contact is two-way: other robots relay, in their heartbeats, the newest heartbeat of this robot that
they know. Contact with such a robot lasts from when that heartbeat was *sent*; no robot can have
heard it before that. `after_us` later this robot stops (`on_lost_contact`). Robots that have heard
nothing of it for `after_us` plus one detection time know that it has stopped. Then they begin what
must not be done in two places at once: exclusive tasks, and local tasks that have a place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mrbt_mesh.core.bt.activation import Activation
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.feature import Kit, Part
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.timing import NEVER_US
from mrbt_mesh.core.membership.wire import Heartbeat
from mrbt_mesh.core.mission.jobs import place_at
from mrbt_mesh.core.mission.mission import majority, performance
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.features.contact.policy import ATTEND, ContactOf, OnLostContact, policies
from mrbt_mesh.features.contact.withdrawal import Withdrawal

CONTACT = "contact"
# How many of its own heartbeats a robot remembers.
KEPT_BEATS = 1_000


class ContactWatch(Part):
    """One robot's contact, in missions with a policy for lost contact.

    `is_lost` is true if this robot has lost contact and has acted on it.
    """

    def __init__(self, kit: Kit, withdrawal: Withdrawal, now_us: int) -> None:
        context = kit.context
        mission, me = context.mission, context.me
        self.is_lost = False
        self._context = context
        self._withdrawal = withdrawal
        self._planner = kit.planner
        self._began_us = now_us
        by_type = policies(mission)
        self._policy = by_type.get(context.config.type)
        # Other robots that stop without contact, and their capabilities.
        self._stopping = {
            robot.id: (robot.capabilities, policy)
            for robot in mission.robots.values()
            if robot.id != me and (policy := by_type.get(robot.type)) is not None
            if policy.is_promise
        }
        self._margin_us = context.config.timing.detection_us
        # When own heartbeats were sent, by number, and when the newest that each robot knows was
        # sent.
        self._sent_us: dict[int, int] = {}
        self._known_us: dict[str, int] = {}
        self._operator_us: int | None = None
        self._has_had = False
        self._returns = False
        # When a postponed start may happen.
        self._begins_us: int | None = None

    # -- signs of life ------------------------------------------------------------------------

    def sent(self, number: int, now_us: int) -> None:
        self._sent_us[number] = now_us
        self._sent_us.pop(number - KEPT_BEATS, None)

    def heard(self, robot: str, beat: Heartbeat, now_us: int) -> None:
        mine = beat.relays.get(self._context.me)
        if mine is not None and mine.incarnation == self._context.replica.incarnation:
            sent_us = self._sent_us.get(mine.number)
            if sent_us is not None:
                self._known_us[robot] = max(sent_us, self._known_us.get(robot, sent_us))

    def words(self) -> Mapping[str, Callable[[str, int], tuple[bool, str]]]:
        return {ATTEND: self._attend}

    def _attend(self, _: str, now_us: int) -> tuple[bool, str]:
        self._operator_us = now_us
        return True, ""

    def _last_us(self, now_us: int, *, are_sure: bool = False) -> int | None:
        """Return when there was contact last, None if never. `are_sure`: see `_aged_us`."""
        assert self._policy is not None
        match self._policy.of:
            case ContactOf.OPERATOR:
                return self._operator_us
            case ContactOf.TEAM:
                return max(self._aged_us(are_sure), default=None)
        wanted = majority(self._context.mission.robot_ids) - 1
        known_us = sorted(self._aged_us(are_sure), reverse=True)
        if not wanted:
            return now_us
        return known_us[wanted - 1] if len(known_us) >= wanted else None

    def _aged_us(self, are_sure: bool) -> list[int]:
        """Return when the newest heartbeats known to other robots were sent, by their clocks.

        With `are_sure`, heartbeats from before a jump of such a clock are omitted, as it may jump
        again.
        """
        clocks = self._context.peer_clocks
        return [
            clocks.aged_us(robot, sent_us)
            for robot, sent_us in self._known_us.items()
            if not are_sure or clocks.is_calm(robot, sent_us)
        ]

    # -- this robot ---------------------------------------------------------------------------

    def next_us(self, now_us: int) -> int | None:
        times_us = [self._begins_us] if self._begins_us is not None else []
        if self._policy is not None and not self.is_lost:
            last_us = self._last_us(now_us)
            since_us = self._began_us if last_us is None else last_us
            times_us.append(since_us + self._policy.after_us)
        return min(times_us, default=None)

    def steps_until_us(self) -> int | None:
        if self._policy is None or not self._policy.is_promise:
            return None
        last_us = self._last_us(self._began_us, are_sure=True)
        return (self._began_us if last_us is None else last_us) + self._policy.after_us

    def check(self, now_us: int) -> bool:
        """React to lost or regained contact. Returns whether the agent has to act on it."""
        if self._policy is None:
            return False
        last_us = self._last_us(now_us)
        since_us = self._began_us if last_us is None else last_us
        is_lost = now_us >= since_us + self._policy.after_us
        is_first = last_us is not None and not self._has_had
        self._has_had |= is_first
        if is_lost != self.is_lost:
            self.is_lost = is_lost
            if is_lost:
                self._lose(now_us)
            else:
                self._regain(now_us)
            return True
        return is_first or (self._returns and self._context.work.action is None)

    def _lose(self, now_us: int) -> None:
        policy = self._policy
        assert policy is not None
        self._context.log("warning", "contact_lost", of=str(policy.of), then=str(policy.then))
        self._returns = policy.then is OnLostContact.RETURN
        # Only robots with contact may write what follows from the silence of others.
        self._planner.decides = policy.of is ContactOf.OPERATOR
        is_after = policy.then is OnLostContact.FINISH
        reason = f"no contact with {_WITH[policy.of]}"
        self._withdrawal.withdraw(CONTACT, reason, now_us, after_task=is_after)

    def _regain(self, now_us: int) -> None:
        self._context.log("info", "contact_back")
        self._returns, self._planner.decides = False, True
        self._planner.forget()
        self._withdrawal.give_back(CONTACT, now_us)

    def end(self, now_us: int) -> None:
        if self.is_lost:
            self._regain(now_us)

    def perform(self, plan: Plan, now_us: int) -> None:
        """Begin the local task of RETURN, once nothing else runs."""
        context, work, policy = self._context, self._context.work, self._policy
        if not self._returns or work.action is not None or policy is None:
            return
        self._returns = False
        value = context.description.performance(policy.local_task)
        assert value is not None
        activation = str(Activation(context.config.run, -1, policy.local_task, (), 0))
        life = context.replica.incarnation
        start = work.start_alone(activation, policy.local_task, value, life, now_us)
        context.emit(start)
        context.log("info", "returns", local_task=policy.local_task)

    # -- others -------------------------------------------------------------------------------

    def may_begin(self, claim: Claim, now_us: int) -> bool:
        """True if this robot may begin.

        It must have contact, and no robot that has lost its own may still be doing this task.
        """
        self._begins_us = None
        if self._policy is not None and (self.is_lost or self._last_us(now_us) is None):
            return False
        mission, local_task = self._context.mission, claim.local_task
        task = self._context.facts.task_of(claim.activation)
        is_exclusive = task is not None and task.at_most_once
        if not self._stopping or not (is_exclusive or place_at(mission, local_task)):
            return True
        begins_us = max((self._stops_us(r) for r in self._may_be_at(local_task)), default=now_us)
        if begins_us > now_us:
            self._begins_us = begins_us
        return begins_us <= now_us

    def _may_be_at(self, local_task: str) -> list[str]:
        """Return the silent robots that stop without contact and are capable of the task."""
        found, peers = [], self._context.membership.peers
        for robot, (capabilities, _) in self._stopping.items():
            peer = peers.get(robot)
            is_silent = peer is None or peer.state is State.DEAD
            if is_silent and performance(capabilities, local_task) is not None:
                found.append(robot)
        return found

    def _stops_us(self, robot: str) -> int:
        """Return when a silent robot has certainly stopped.

        That is never known for the policy MAJORITY if this robot does not hear a majority.
        """
        _, policy = self._stopping[robot]
        membership = self._context.membership
        if policy.of is ContactOf.MAJORITY:
            heard = 1 + sum(peer.state.is_healthy for peer in membership.peers.values())
            if heard < majority(self._context.mission.robot_ids):
                return NEVER_US
        peer = membership.peers.get(robot)
        since_us = self._began_us if peer is None else peer.last_heard_us
        return since_us + policy.after_us + self._margin_us


_WITH = {
    ContactOf.TEAM: "any other robot",
    ContactOf.MAJORITY: "a majority of the robots",
    ContactOf.OPERATOR: "an operator",
}
