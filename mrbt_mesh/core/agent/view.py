"""Read access to an agent from outside."""

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
    """An agent as it is now, read-only. It changes with the agent.

    `robot`: its id. `header`: of its messages. `facts`: its replica of the team's facts. `peers`:
    the other robots as it knows them. `alive()`: the alive set of its plan, including itself.
    `stepping`: until when its program may go on. `judges(robot)`: whether it judges the silence of
    another robot. `refused`: how often input was refused, by source and reason.
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
        # Set when the parts of the agent are composed.
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
        """True if it needs WallClockRead."""
        return self._context.wall_clock is not None

    @property
    def spacing_us(self) -> int:
        """How long inputs from others may wait after the last ones, to be processed together."""
        return self._context.membership.around.plan_spacing_us

    @property
    def is_calm(self) -> bool:
        """True if it suspects no robot, so that heartbeats without news may wait a little."""
        return not self._context.membership.has_suspects

    @property
    def is_joining(self) -> bool:
        """True until it has joined, and while it catches up or joins again."""
        return self._context.joining is not None

    @property
    def is_leaving(self) -> bool:
        """True if it is about to leave the team."""
        return self._context.is_leaving

    @property
    def lost(self) -> Mapping[str, str]:
        """The capabilities that it has lost, and why."""
        return self._context.description.lost

    @property
    def position(self) -> Position | None:
        """The last position that its program has reported."""
        return self._context.position

    @property
    def version(self) -> tuple[int, int]:
        """Two numbers that grow with each change of its facts and of its alive set."""
        return self._context.facts.changes, self._context.membership.member_changes

    @property
    def suspicion_changes(self) -> int:
        """Grows when a token appears or disappears, and when others' suspicions change."""
        return self._context.membership.suspicion_changes

    @property
    def plan(self) -> Plan | None:
        """Its newest plan, None while it has never joined."""
        return self._planner.plan

    @property
    def is_plan_current(self) -> bool:
        """True if the plan was made for its present facts and alive set."""
        return self._planner.is_current

    @property
    def awaited_plan(self) -> int | None:
        """The number of the plan being made elsewhere (`effects.MakePlan`), None if none is."""
        awaited = self._planner.awaited
        return awaited.number if awaited is not None else None

    @property
    def waits_for_deadline(self) -> bool:
        """True if a time limit of the tree, of a blocked task or of bids is running."""
        return self._planner.next_deadline_us() is not None

    def agrees(self) -> bool:
        """True if all healthy robots report its plan."""
        plan = self._planner.plan
        return plan is not None and self._context.membership.all_report_plan(plan.digest)

    def subscribe_to_plans(self, listener: PlanListener) -> None:
        """Have `listener` called with each new plan, before any fact changes again."""
        self._planner.listeners.append(listener)

    @property
    def statuses(self) -> tuple[Status, ...]:
        """The statuses of T_i, T_A, T_G and T_Li after the last tick."""
        return self._tree.statuses

    @property
    def tree_statuses(self) -> bytes:
        """The statuses of the nodes of its local task's tree; empty if no tree carries it out."""
        return self._context.work.tree_statuses

    @property
    def claim(self) -> Claim | None:
        """The activation that it works on, or is about to work on."""
        return self._context.work.claim

    @property
    def action(self) -> StartAction | None:
        """The action that it has started and that has not ended."""
        return self._context.work.action
