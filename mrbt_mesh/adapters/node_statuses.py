"""A tree of a mission with the statuses of its nodes, as an observer sees them.

T_G is the same for all robots. T_i of one robot contains T_A, T_G and T_Li. The statuses in T_A and
T_Li are not sent; they are derived from the facts of the team.
"""

from __future__ import annotations

from mrbt_mesh.core.bt.evaluator import parallel_status
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status, build_tree
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.own_trees import OwnTrees


class ObservedTree:
    """T_G, or T_i of a robot of the mission file; in T_Li a local task is a single leaf."""

    def __init__(self, mission: Mission, robot: str | None = None) -> None:
        """Build T_i of `robot`, by default T_G. Raises InputError for an unknown robot."""
        self._own: OwnTrees | None = None
        self.tree, self.title = mission.tree, f"T_G of {mission.name}"
        if robot is None:
            return
        if robot not in mission.robots:
            known = ", ".join(mission.robots)
            raise InputError(f"mission {mission.name} has no robot {robot!r} (it has {known})")
        self.title = f"T_i of {robot} ({mission.name})"
        self._own = OwnTrees(robot, mission.robots[robot].capabilities)
        parts = {"T_A": self._own.assignment, "T_G": mission.tree, "T_Li": self._own.local}
        children = tuple(
            NodeSpec(Kind.SUBTREE, (tree.spec(),), name) for name, tree in parts.items()
        )
        self.tree = build_tree(NodeSpec(Kind.PARALLEL, children, f"T_{robot}", limit=len(parts)))

    def statuses(self, observer: Observer) -> bytes:
        """Return the `Status` of each node as one byte.

        All nodes are idle while the robot is not a member of the team, or for T_G while no robot is
        known.
        """
        plan = observer.plan
        team = bytes(len(observer.mission.tree.nodes))
        if plan is not None and observer.robots():
            team = plan.evaluation.declared_statuses(observer.mission.tree)
        if self._own is None:
            return team
        assignment, local = self._own.statuses(observer)
        if not local[0]:
            return bytes(len(self.tree.nodes))
        parts = assignment, team, local
        whole = parallel_status(tuple(Status(part[0]) for part in parts), len(parts))
        return bytes([whole]) + b"".join(part[:1] + part for part in parts)
