"""A tree of a mission with the statuses of its nodes, as an observer sees them.

T_G is the same for all robots. T_i of one robot has T_A, T_G and T_Li below it; the statuses in T_A
and T_Li are not sent, and follow from the facts of the team.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from mrbt_mesh.core.bt.evaluator import parallel_status
from mrbt_mesh.core.bt.robot_tree import local_tree
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status, Tree, build_tree
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.errors import InputError
from mrbt_mesh.views.model.own_trees import OwnTrees

T_A, T_G, T_LI = "T_A", "T_G", "T_Li"


class ObservedTree(Protocol):
    """A tree, and a status for each of its nodes."""

    @property
    def tree(self) -> Tree: ...

    @property
    def title(self) -> str:
        """What it is, for people."""
        ...

    def statuses(self, observer: Observer) -> bytes:
        """One byte for each node, the value of its `Status`; all idle while no robot is known."""
        ...


@dataclass(frozen=True)
class GlobalTree:
    """T_G."""

    mission: Mission

    @property
    def tree(self) -> Tree:
        """The mission's own."""
        return self.mission.tree

    @property
    def title(self) -> str:
        """Of which mission."""
        return f"{T_G} of {self.mission.name}"

    def statuses(self, observer: Observer) -> bytes:
        """As the observer's plan has them, which is the team's."""
        plan = observer.plan
        if plan is None or not observer.robots():
            return bytes(len(self.tree.nodes))
        return plan.evaluation.statuses


class RobotTrees:
    """T_i of one robot. A local task that is a tree of its own is one leaf of T_Li."""

    def __init__(self, mission: Mission, robot: str, capabilities: Mapping[str, int]) -> None:
        self.robot = robot
        self.title = f"T_i of {robot} ({mission.name})"
        self._global = GlobalTree(mission)
        names = frozenset(type_name(name) for name in capabilities)
        self._own = OwnTrees(robot, local_tree(names))
        parts = (
            (T_A, self._own.assignment.spec()),
            (T_G, mission.tree.spec()),
            (T_LI, self._own.local.spec()),
        )
        children = tuple(NodeSpec(Kind.SUBTREE, (spec,), name) for name, spec in parts)
        spec = NodeSpec(Kind.PARALLEL, children, f"T_{robot}", limit=len(parts))
        self.tree = build_tree(spec)

    def statuses(self, observer: Observer) -> bytes:
        """Those of T_A and T_Li as `OwnTrees` has them; all idle unless the robot lives."""
        assignment, local = self._own.statuses(observer)
        if not local[0]:
            return bytes(len(self.tree.nodes))
        parts = assignment, self._global.statuses(observer), local
        whole = parallel_status(tuple(Status(part[0]) for part in parts), len(parts))
        return bytes([whole]) + b"".join(part[:1] + part for part in parts)


def observed_tree(mission: Mission, robot: str | None) -> ObservedTree:
    """T_G, or T_i of a robot of the mission file; raises InputError for one that it lacks."""
    if robot is None:
        return GlobalTree(mission)
    if robot not in mission.robots:
        known = ", ".join(mission.robots)
        raise InputError(f"mission {mission.name} has no robot {robot!r} (it has {known})")
    return RobotTrees(mission, robot, mission.robots[robot].capabilities)
