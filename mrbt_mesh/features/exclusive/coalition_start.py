"""Starting as a coalition: robots get *ready*, and all members start together.

The leader starts when enough members are ready, and writes them down; the other members start once
it has done so.
"""

from __future__ import annotations

from collections.abc import Iterable

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.start_policy import Clearance, Situation, StartPolicy
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.feature import Part
from mrbt_mesh.core.mission.mission import GlobalTask
from mrbt_mesh.core.planning.plan import RobotAssignment
from mrbt_mesh.features.exclusive.coalitions import (
    coalition_at_work,
    coalitions_of,
    has_enough_members,
    ready_members,
)
from mrbt_mesh.features.exclusive.kinds import COALITION
from mrbt_mesh.features.exclusive.records import Coalition, CoalitionId

# A robot whose claim is in one of these phases has promised nothing to a coalition.
_BEFORE = (Phase.CLAIMED, Phase.TRAVELLING)


class CoalitionStart(StartPolicy, Part):
    """Starts a robot together with the other members of its coalition."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def start_policy(self, task: GlobalTask) -> StartPolicy | None:
        return self if task.joint is not None and not task.at_most_once else None

    @property
    def needs_ready(self) -> bool:
        """True: a robot first writes that it is ready."""
        return True

    def clear(self, situation: Situation) -> Clearance | None:
        """The coalition that this robot may start with now, as written down by its leader."""
        facts, (plan, assignment, claim, is_grace_over, now_us) = self._context.facts, situation
        if assignment.leader != self._context.me:
            return self._written_down(assignment.activation, claim, now_us)
        token = self.token(assignment, claim)
        assert token is not None
        if not self.may_work(assignment.activation, token, now_us):
            return None
        planned = {
            each.robot: each.local_task
            for each in plan.assignments.values()
            if each.activation == assignment.activation
        }
        members = ready_members(facts, assignment.activation, planned)
        if not has_enough_members(facts.task(claim.activation), members):
            return None
        if len(members) < len(planned) and not (is_grace_over and self._all_are_there(planned)):
            return None  # the others may be ready in a moment
        name = f"{COALITION}/{assignment.activation}/{token}"
        return Clearance(str(token), ((name, Coalition(tuple(members))),))

    def _all_are_there(self, robots: Iterable[str]) -> bool:
        """True if none of these robots, all assigned to this task, is still travelling."""
        return not any(self._context.facts.under_way(robot) for robot in robots)

    def _written_down(self, activation: str, claim: Claim, now_us: int) -> Clearance | None:
        """The standing coalition, if its leader has written down this robot's present claim."""
        context, facts = self._context, self._context.facts
        task = facts.task(claim.activation)
        token = coalition_at_work(facts, task, activation, context.alive())
        if token is None or not self.may_work(activation, token, now_us):
            return None
        mine = (claim.since, context.me, context.replica.incarnation)
        for member in coalitions_of(facts, activation).members[token]:
            if (member.since, member.robot, Incarnation(member.counter, member.nonce)) == mine:
                return Clearance(str(token))
        return None

    def may_work(self, activation: str, token: CoalitionId, now_us: int) -> bool:
        """True if the coalition may work on the activation now."""
        return True

    def token(self, assignment: RobotAssignment, claim: Claim) -> CoalitionId | None:
        """The coalition that this robot is ready for, or runs with; None if there is none."""
        context, facts, leader = self._context, self._context.facts, assignment.leader
        if not leader or claim.phase in _BEFORE:
            return None
        if claim.party:
            return CoalitionId.parse(claim.party)
        if leader == context.me:
            return CoalitionId(claim.since, context.me, *context.replica.incarnation)
        leaders = facts.valid_claim(leader)
        if leaders is None or leaders.activation != assignment.activation:
            return None
        if leaders.phase in _BEFORE:
            return None
        return CoalitionId(leaders.since, leader, *facts.members[leader].incarnation)
