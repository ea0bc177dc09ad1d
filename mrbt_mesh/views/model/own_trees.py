"""T_A and T_Li of one robot, with the statuses of their nodes as far as they can be seen.

A robot reports the statuses of the roots, and of the tree that carries out its local task if there
is one; the rest follows from the team's facts.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from mrbt_mesh.core.bt.evaluation import OwnFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.robot_tree import (
    ASSIGN_AGENTS,
    ASSIGNED,
    CHECK_CONSISTENCY,
    NEW_GLOBAL_TASK_EXECUTED,
    assignment_tree,
    local_tree,
)
from mrbt_mesh.core.bt.tree import Status, Tree
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.inner_trees import with_inner_trees
from mrbt_mesh.views.model.mission_view import tree_view


class OwnTrees:
    """T_A and T_Li of one robot with these capabilities; in T_Li a local task is one leaf."""

    def __init__(self, robot: str, capabilities: Iterable[str]) -> None:
        self._robot = robot
        self._assignment = Evaluator(assignment_tree())
        self._local = Evaluator(local_tree(set(map(type_name, capabilities))))

    @property
    def assignment(self) -> Tree:
        """T_A."""
        return self._assignment.tree

    @property
    def local(self) -> Tree:
        """T_Li."""
        return self._local.tree

    def statuses(self, observer: Observer) -> tuple[bytes, bytes]:
        """(T_A's by the last plan, T_Li's by the robot's claim); all idle unless it is a member."""
        plan = observer.plan
        if plan is None or not observer.robot_state(self._robot).is_member:
            return bytes(len(self.assignment.nodes)), bytes(len(self.local.nodes))
        assignment = self._assignment.evaluate(_assignment_facts(plan))
        local = self._local.evaluate(_local_facts(observer, self._robot))
        return assignment.statuses, local.statuses


class RunningTree(NamedTuple):
    """The tree that carries out a robot's local task, with the statuses of its nodes in preorder.

    Both are empty if there is none.
    """

    local_task: str
    statuses: bytes


def running_tree(observer: Observer, robot: str) -> RunningTree:
    """Return the running tree as the robot last reported it."""
    claim, peer = observer.claim(robot), observer.membership.peers.get(robot)
    beat = peer.heartbeat if peer is not None and peer.state.is_member else None
    if claim is None or beat is None or claim.phase is not Phase.RUNNING:
        return RunningTree("", b"")
    return RunningTree(claim.local_task, beat.tree_statuses)


def _assignment_facts(plan: Plan) -> OwnFacts:
    """Return what the leaves of T_A returned when this plan was computed."""
    holding = {NEW_GLOBAL_TASK_EXECUTED, *([CHECK_CONSISTENCY] if plan.consistent else [])}
    solved = Status.SUCCESS if plan.feasible else Status.FAILURE
    return OwnFacts(frozenset(holding), {ASSIGN_AGENTS: solved})


def _local_facts(observer: Observer, robot: str) -> OwnFacts:
    claim = observer.claim(robot)
    if claim is None:
        return OwnFacts(frozenset())
    return OwnFacts(frozenset({ASSIGNED, f"{ASSIGNED}({type_name(claim.local_task)})"}))


def own_trees(observer: Observer, robot: str) -> dict[str, Any]:
    """`T_A` and `T_Li`: nodes and statuses. Raises KeyError for a robot without a description."""
    member = observer.facts.members[robot].member
    trees = OwnTrees(robot, member.capabilities)
    assignment, local = trees.statuses(observer)
    running = running_tree(observer, robot)
    rows, statuses = with_inner_trees(tree_view(trees.local), local, observer.mission, running)
    return {
        "robot": robot,
        "T_A": {"tree": tree_view(trees.assignment), "statuses": list(assignment)},
        "T_Li": {"tree": rows, "statuses": statuses},
    }
