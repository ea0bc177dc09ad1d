"""Trees as rows that can be folded and searched: T_G, and T_i of a robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.text import Text

from mrbt_mesh.cli.views.marks import MARKS
from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.inner_trees import with_inner_trees
from mrbt_mesh.views.model.mission_view import tree_view
from mrbt_mesh.views.model.own_trees import OwnTrees, running_tree

# Larger trees begin with everything folded that is not running.
LARGE = 30
NEVER_TICKED: list[Any] = [int(Status.IDLE), [], "", 0]

MEANINGS = {"T_A": "how it plans", "T_G": "the team's tree", "T_Li": "its own tasks"}


class FoldingTree:
    """Determines which rows are shown. `rows`: nodes by index, as in `tree_view`."""

    def __init__(self, rows: list[dict[str, Any]]) -> None:
        self.rows = rows
        self.folds_resting = len(rows) > LARGE
        # Rows folded or unfolded by hand.
        self._by_hand: dict[int, bool] = {}
        self._children: list[list[int]] = [[] for _ in rows]
        for index, row in enumerate(rows):
            if row["parent"] >= 0:
                self._children[row["parent"]].append(index)

    def children(self, index: int) -> list[int]:
        """Return the rows below a row.

        A subtree replaces its only child, which has the same status.
        """
        below = self._children[index]
        if self.rows[index]["kind"] == str(Kind.SUBTREE) and below:
            return self._children[below[0]] or below
        return below

    def parent(self, index: int) -> int:
        """Return the row above a row, -1 at the root."""
        above = int(self.rows[index]["parent"])
        is_passed_over = above > 0 and index in self.children(self.rows[above]["parent"])
        return int(self.rows[above]["parent"]) if is_passed_over else above

    def is_folded(self, index: int, nodes: Mapping[int, list[Any]]) -> bool:
        """Return whether the rows below it are hidden; `nodes`: as in `TeamView`."""
        if not self._children[index]:
            return False
        runs = nodes.get(index, NEVER_TICKED)[0] == Status.RUNNING
        return self._by_hand.get(index, self.folds_resting and not runs)

    def fold(self, index: int, is_folded: bool) -> None:
        """Fold or unfold a row, whatever its status."""
        if self._children[index]:
            self._by_hand[index] = is_folded

    def fold_resting(self, folds: bool) -> None:
        """Fold what is not running, or nothing; folds made by hand are forgotten."""
        self.folds_resting = folds
        self._by_hand.clear()

    def visible(self, nodes: Mapping[int, list[Any]]) -> list[tuple[int, int]]:
        """Return (index, depth) of every visible row, from the top."""
        found, waiting = [], [(0, 0)]
        while waiting:
            index, depth = waiting.pop()
            found.append((index, depth))
            if not self.is_folded(index, nodes):
                waiting.extend((child, depth + 1) for child in reversed(self.children(index)))
        return found

    def find(self, words: str, after: int, step: int = 1) -> int | None:
        """Return the next row (`step` -1: the previous one) whose label has these words.

        Wraps around.
        """
        rows = [index for index, _ in _unfolded(self)]
        start = rows.index(after) if after in rows else -1
        for offset in range(1, len(rows) + 1):
            index = rows[(start + step * offset) % len(rows)]
            if words.casefold() in self.rows[index]["label"].casefold():
                return index
        return None

    def reveal(self, index: int) -> None:
        """Unfold everything that hides a row."""
        above = self.parent(index)
        while above >= 0:
            self._by_hand[above] = False
            above = self.parent(above)

    def text(self, index: int, depth: int, nodes: Mapping[int, list[Any]]) -> Text:
        """Return a row: fold sign, status sign, label, robots at work, what it awaits, status."""
        number, robots, note, count = nodes.get(index, NEVER_TICKED)
        status = Status(number)
        sign, style = MARKS[status]
        if status is Status.FAILURE and self.rows[index]["kind"] == str(Kind.CONDITION):
            # A condition that does not hold is no problem.
            style = "dim"
        fold = "▸" if self.is_folded(index, nodes) else "▾" if self._children[index] else " "
        text = Text(no_wrap=True).append("  " * depth + fold + " ", "dim")
        text.append(f"{sign} ", style)
        text.append(self.rows[index]["label"], "dim" if status is Status.IDLE else "")
        if robots:
            text.append("  " + " ".join(robots), "bold cyan")
        if note:
            text.append(f"  {note}", "red" if note == "blocked" else "yellow")
        if count > 1:
            text.append(f"  ×{count}", "dim")
        if status is not Status.IDLE and not (robots and status is Status.RUNNING):
            text.append(f"  {status.name.lower()}", "dim")
        return text


def _unfolded(tree: FoldingTree) -> list[tuple[int, int]]:
    """Return all rows."""
    opened = FoldingTree(tree.rows)
    opened.fold_resting(False)
    return opened.visible({})


class RobotRows:
    """T_i = Parallel(T_A, T_G, T_Li, 3) of one robot, with T_G as one row.

    `rows`: as in `tree_view`, from the root T_i; `nodes`: as in `TeamView`.
    """

    def __init__(self, observer: Observer, robot: str) -> None:
        """Raises KeyError for a robot without a description."""
        self.robot = robot
        self._observer = observer
        self._capabilities = observer.facts.members[robot].member.capabilities
        self._trees = OwnTrees(robot, self._capabilities)
        self.rows = [_row(f"T_i: {Kind.PARALLEL} 3/3", Kind.PARALLEL, -1)]
        self._add("T_A", tree_view(self._trees.assignment))
        self.rows.append(_row(f"T_G, {MEANINGS['T_G']}", Kind.SUBTREE, 0))
        self._local = tree_view(self._trees.local)
        self._add("T_Li", self._with_inner_trees(bytes(len(self._local)))[0])

    def is_of(self, observer: Observer) -> bool:
        """Return whether these are the robot's trees as this observer knows it.

        A restarted robot may have other capabilities, and a recording another observer.
        """
        known = observer.facts.members.get(self.robot)
        is_same = known is not None and known.member.capabilities == self._capabilities
        return is_same and observer is self._observer

    def nodes(self, reported: Sequence[str]) -> dict[int, list[Any]]:
        """Return the current nodes.

        `reported`: the statuses of T_i, T_A, T_G and T_Li as words, last reported by the robot;
        empty if it is not present.
        """
        whole, _, team, _ = [int(Status[word.upper()]) for word in reported or ["idle"] * 4]
        assignment, local = self._trees.statuses(self._observer)
        statuses = [whole, *assignment, team, *self._with_inner_trees(local)[1]]
        return {index: [status, [], "", 0] for index, status in enumerate(statuses)}

    def _with_inner_trees(self, statuses: bytes) -> tuple[list[dict[str, Any]], list[int]]:
        running = running_tree(self._observer, self.robot)
        return with_inner_trees(self._local, statuses, self._observer.mission, running)

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
