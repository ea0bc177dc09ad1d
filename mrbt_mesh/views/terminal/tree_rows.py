"""T_G as rows that fold, are searched, and tell the status of each node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.text import Text

from mrbt_mesh.cli.views.marks import MARKS
from mrbt_mesh.core.bt.tree import Kind, Status

# Larger trees begin with what does not run folded.
LARGE = 30
NEVER_TICKED: list[Any] = [int(Status.IDLE), [], "", 0]


class FoldingTree:
    """Which rows are shown. `rows`: nodes by index, as `tree_view` tells them."""

    def __init__(self, rows: list[dict[str, Any]]) -> None:
        self.rows = rows
        self.folds_resting = len(rows) > LARGE
        # What was folded or unfolded by hand.
        self._by_hand: dict[int, bool] = {}
        self._children: list[list[int]] = [[] for _ in rows]
        for index, row in enumerate(rows):
            if row["parent"] >= 0:
                self._children[row["parent"]].append(index)

    def children(self, index: int) -> list[int]:
        """The rows below a row. A subtree's one child has its status: its name says more."""
        below = self._children[index]
        if self.rows[index]["kind"] == str(Kind.SUBTREE) and below:
            return self._children[below[0]] or below
        return below

    def parent(self, index: int) -> int:
        """The row above a row, -1 at the root."""
        above = int(self.rows[index]["parent"])
        is_passed_over = above > 0 and index in self.children(self.rows[above]["parent"])
        return int(self.rows[above]["parent"]) if is_passed_over else above

    def is_folded(self, index: int, nodes: Mapping[int, list[Any]]) -> bool:
        """Whether what is below it is hidden; `nodes` as `TeamView` tells them."""
        if not self._children[index]:
            return False
        runs = nodes.get(index, NEVER_TICKED)[0] == Status.RUNNING
        return self._by_hand.get(index, self.folds_resting and not runs)

    def fold(self, index: int, is_folded: bool) -> None:
        """Fold or unfold it, whatever its status."""
        if self._children[index]:
            self._by_hand[index] = is_folded

    def fold_resting(self, folds: bool) -> None:
        """Fold what does not run, or nothing; what was done by hand is forgotten."""
        self.folds_resting = folds
        self._by_hand.clear()

    def visible(self, nodes: Mapping[int, list[Any]]) -> list[tuple[int, int]]:
        """(index, depth) of every row that is shown, from the top."""
        found, waiting = [], [(0, 0)]
        while waiting:
            index, depth = waiting.pop()
            found.append((index, depth))
            if not self.is_folded(index, nodes):
                waiting.extend((child, depth + 1) for child in reversed(self.children(index)))
        return found

    def find(self, words: str, after: int, step: int = 1) -> int | None:
        """The next row (`step` -1: the one before) whose label has these words; it goes round."""
        rows = [index for index, _ in _unfolded(self)]
        start = rows.index(after) if after in rows else -1
        for offset in range(1, len(rows) + 1):
            index = rows[(start + step * offset) % len(rows)]
            if words.casefold() in self.rows[index]["label"].casefold():
                return index
        return None

    def reveal(self, index: int) -> None:
        """Unfold all that hides it."""
        above = self.parent(index)
        while above >= 0:
            self._by_hand[above] = False
            above = self.parent(above)

    def text(self, index: int, depth: int, nodes: Mapping[int, list[Any]]) -> Text:
        """A row: fold sign, status sign, label, who works there, what it waits for, status."""
        number, robots, note, count = nodes.get(index, NEVER_TICKED)
        status = Status(number)
        sign, style = MARKS[status]
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
        if status is not Status.IDLE:
            text.append(f"  {status.name.lower()}", "dim")
        return text


def _unfolded(tree: FoldingTree) -> list[tuple[int, int]]:
    """All rows there are."""
    opened = FoldingTree(tree.rows)
    opened.fold_resting(False)
    return opened.visible({})
