"""What may be looked at from outside of an agent; nothing of it may be changed there."""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.planner import PlanListener, Planner
from mrbt_mesh.core.agent.stepping import Stepping
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.peer import Peer
from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan


class AgentView:
    """An agent as it is now, read-only: it changes with the agent.

    `robot`: its id. `header`: that of its messages. `facts`: its replica of the team's facts.
    `peers`: the other robots as it knows them. `alive()`: the alive set of its plan, itself
    included. `stepping`: until when its program may go on. `judges(robot)`: whether it judges the
    silence of another robot. `refused`: how often input was refused, by source and reason.
    """

    def __init__(self, context: Context, planner: Planner, tree: RobotTree) -> None:
        self.robot = context.me
        self.header = context.replica.header
        self.facts = context.facts
        self.peers: Mapping[str, Peer] = context.membership.peers
        self.alive = context.alive
        self.judges = context.membership.around.judges
        self.refused: Mapping[str, int] = context.refused
        self._context = context
        self._planner = planner
        self._tree = tree
        # Composed with the parts of the agent.
        self.stepping: Stepping

    @property
    def mission(self) -> Mission:
        """The mission, with the trees of open jobs in its tree."""
        return self.facts.mission

    @property
    def incarnation(self) -> Incarnation:
        """Its incarnation; counter 0 while it has never joined."""
        return self._context.replica.incarnation

    @property
    def reads_wall_clock(self) -> bool:
        """Whether it needs WallClockRead."""
        return self._context.wall_clock is not None

    @property
    def spacing_us(self) -> int:
        """How long inputs from others may wait after the last ones, to be taken in together."""
        return self._context.membership.around.plan_spacing_us

    @property
    def is_calm(self) -> bool:
        """Whether it suspects no robot: then heartbeats without news may wait a little."""
        return not self._context.membership.has_suspects

    @property
    def is_joining(self) -> bool:
        """Whether it has yet to take its place in the team."""
        return self._context.joining is not None

    @property
    def is_leaving(self) -> bool:
        """Whether it is on its way out."""
        return self._context.is_leaving

    @property
    def lost(self) -> Mapping[str, str]:
        """The capabilities that it has lost, and why."""
        return self._context.description.lost

    @property
    def position(self) -> Position | None:
        """The last one that its program has reported."""
        return self._context.position

    @property
    def version(self) -> tuple[int, int]:
        """Two numbers that grow with each change of its facts and of its alive set."""
        return self._context.facts.changes, self._context.membership.member_changes

    @property
    def suspicion_changes(self) -> int:
        """Grows with every token that comes or goes, and with every suspicion of others."""
        return self._context.membership.suspicion_changes

    @property
    def plan(self) -> Plan | None:
        """Its newest plan, None while it has never joined."""
        return self._planner.plan

    @property
    def is_plan_current(self) -> bool:
        """Whether the plan is that of its facts and its alive set as they are now."""
        return self._planner.is_current

    @property
    def awaited_plan(self) -> int | None:
        """The number of the plan that is being made elsewhere (`effects.MakePlan`)."""
        awaited = self._planner.awaited
        return awaited.number if awaited is not None else None

    @property
    def waits_for_deadline(self) -> bool:
        """Whether a time limit of the tree, of a blocked task or of bids is running."""
        return self._planner.next_deadline_us() is not None

    def agrees(self) -> bool:
        """Whether all robots in good standing report its plan."""
        plan = self._planner.plan
        return plan is not None and self._context.membership.all_report_plan(plan.digest)

    def subscribe_to_plans(self, listener: PlanListener) -> None:
        """Have `listener` called with each new plan, between the changes of facts around it."""
        self._planner.listeners.append(listener)

    @property
    def statuses(self) -> tuple[Status, ...]:
        """Those of T_i, T_A, T_G and T_Li after the last tick."""
        return self._tree.statuses

    @property
    def tree_statuses(self) -> bytes:
        """Of the nodes of the tree that carries out its local task; empty if none does."""
        return self._context.work.tree_statuses

    @property
    def claim(self) -> Claim | None:
        """The activation that it works on, or is about to."""
        return self._context.work.claim

    @property
    def action(self) -> StartAction | None:
        """The action that it has started and that has not ended."""
        return self._context.work.action
