"""Signs and styles of statuses and states; no meaning depends on a colour alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.cli.printing import Styled
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.mission.names import name_order

MARKS = {
    Status.IDLE: ("·", "dim"),
    Status.RUNNING: ("▶", "bold cyan"),
    Status.SUCCESS: ("✔", "green"),
    Status.FAILURE: ("✘", "red"),
}
# Marks of robot states, in the words of `TeamView`.
STATE_MARKS = {
    "alive": ("●", "green"),
    "joining": ("◌", "cyan"),
    "suspect": ("?", "yellow"),
    "leaving": ("◐", "yellow"),
    "dead": ("✖", "bold red"),
    "left": ("○", "dim"),
}
# Words for people where they differ, as in the headline and on the page.
STATE_WORDS = {"suspect": "silent"}
# Marks by `WorkEnd`. A death has a mark of its own.
END_MARKS = {"done": ("✔", "green"), "failed": ("✘", "red"), "dropped": ("┤", "dim")}
# Marks of a headline's statements, by `Level`.
LEVEL_MARKS = {
    "bad": ("✘", "bold red"),
    "warn": ("!", "yellow"),
    "info": ("·", "cyan"),
    "good": ("✔", "green"),
}


def statement_text(statement: Mapping[str, str]) -> Styled:
    """Return a statement of a headline, given as plain data, with its sign and colour."""
    sign, style = LEVEL_MARKS[statement["level"]]
    return Styled(f"{sign} {statement['text']}", style)


def by_urgency(robots: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the robots by urgency: in trouble first, then at work, then all other.

    `robots` maps names to rows with `state`, `lost`, `problems` and `local_task`.
    """

    def rank(robot: str) -> tuple[int, tuple[tuple[bool, int, str], ...]]:
        row = robots[robot]
        if row["state"] in ("dead", "suspect") or row["lost"] or row["problems"]:
            return 0, name_order(robot)
        return 1 if row["local_task"] else 2, name_order(robot)

    return sorted(robots, key=rank)
