"""What happened beside what would have happened, for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

_TASK_STATES = ("success", "failure", "running", "cancelled", "not_started")


def render_what_if(data: Mapping[str, Any]) -> RenderableType:
    """Result, end, tasks and takeovers of both, and what was assumed."""
    table = Table(box=None, header_style="dim")
    for heading in ("", "what happened", "what if"):
        table.add_column(heading)
    rows = (data["recorded"], data["what_if"])
    table.add_row("result", *(Text(row["result"], "bold") for row in rows))
    table.add_row("over", *(_time(row["over_at_s"]) for row in rows))
    for state in _TASK_STATES:
        counts = [
            sum(task["status"] == state for task in row["global_tasks"].values()) for row in rows
        ]
        if any(counts):
            table.add_row(f"tasks: {state}", *map(str, counts))
    table.add_row("blocked", *("; ".join(_blocked(row)) or "nothing" for row in rows))
    faults = ", ".join(data["faults"]) or "no fault"
    under_way = ", ".join(f"{robot}: {task}" for robot, task in data["under_way"].items())
    return Group(
        Text(f"from {data['at_s']:g} s on: {faults}", "bold"),
        Text(f"under way then: {under_way or 'nothing'}"),
        table,
        *(Text(f"assumed: {text}", "dim") for text in data["assumed"]),
    )


def _time(seconds: float | None) -> str:
    return "not" if seconds is None else f"at {seconds:.2f} s"


def _blocked(summary: Mapping[str, Any]) -> list[str]:
    """Requests that were blocked at the end."""
    return [f"{row['request']} {row['reason']}" for row in summary["blocked"] if row["to"] is None]
