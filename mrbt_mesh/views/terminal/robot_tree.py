"""T_i = Parallel(T_A, T_G, T_Li, 3) of one robot as one tree: rows, and the statuses of its nodes.

T_G is one row of it: the mission's tree has the pane to itself otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.views.model.mission_view import tree_view
from mrbt_mesh.views.model.own_trees import OwnTrees, local_tree_of, running_tree
from mrbt_mesh.views.model.program_trees import with_programs

MEANINGS = {"T_A": "how it plans", "T_G": "the team's tree", "T_Li": "its own tasks"}


class RobotRows:
    """`rows` as `tree_view` tells them, T_i being the root; `nodes` as `TeamView` tells them."""

    def __init__(self, observer: Observer, robot: str) -> None:
        """Raises KeyError for a robot without a description."""
        self.robot = robot
        self._observer = observer
        self._capabilities = self._described()
        self._trees = OwnTrees(robot, local_tree_of(observer.mission, self._capabilities))
        self.rows = [_row(f"T_i: {Kind.PARALLEL} 3/3", Kind.PARALLEL, -1)]
        self._add("T_A", tree_view(self._trees.assignment))
        self.rows.append(_row(f"T_G, {MEANINGS['T_G']}", Kind.SUBTREE, 0))
        self._local = tree_view(self._trees.local)
        self._add("T_Li", self._with_programs(bytes(len(self._local)))[0])

    def is_current(self) -> bool:
        """Whether the robot describes itself as it did; one that is started again may not."""
        return self._described() == self._capabilities

    def nodes(self, reported: Sequence[str]) -> dict[int, list[Any]]:
        """What they are now.

        `reported`: the statuses of T_i, T_A, T_G and T_Li as words, as the robot told them last;
        empty if it is not there.
        """
        whole, _, team, _ = [int(Status[word.upper()]) for word in reported or ["idle"] * 4]
        assignment, local = self._trees.statuses(self._observer)
        statuses = [whole, *assignment, team, *self._with_programs(local)[1]]
        return {index: [status, [], "", 0] for index, status in enumerate(statuses)}

    def _described(self) -> Mapping[str, int]:
        return self._observer.facts.members[self.robot].member.capabilities

    def _with_programs(self, statuses: bytes) -> tuple[list[dict[str, Any]], list[int]]:
        running = running_tree(self._observer, self.robot)
        return with_programs(self._local, statuses, self._observer.mission, running)

    def _add(self, part: str, rows: Sequence[Mapping[str, Any]]) -> None:
        first = len(self.rows)
        for given in rows:
            row = dict(given)
            if row["parent"] < 0:
                row |= {"label": f"{part}, {MEANINGS[part]}: {row['label']}", "parent": 0}
            else:
                row["parent"] += first
            self.rows.append(row)


def _row(label: str, kind: Kind, parent: int) -> dict[str, Any]:
    return {"kind": str(kind), "label": label, "name": "", "subject": "", "parent": parent}
