"""The status of a team as people read it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from mrbt_mesh.cli.views.marks import STATE_MARKS
from mrbt_mesh.cli.views.plan_view import render_bounds
from mrbt_mesh.cli.views.summary_view import (
    MOST_FAILURES,
    capability_changes,
    failure_line,
    problem_line,
)

# So many reasons of refusals are named for each robot; `--json` has all.
MOST_REASONS = 5


def render_status(data: Mapping[str, Any]) -> RenderableType:
    """What `mrbt status --json` prints, for a terminal."""
    agreement = (
        Text("all agree") if data["agreement"] else Text("the robots are agreeing", "yellow")
    )
    return Group(
        Text.assemble((str(data["mission"]), "bold"), f": {data['result']}{_standing(data)}"),
        _robots(data["robots"]),
        *_tasks(data["global_tasks"]),
        *([render_bounds(data["bounds"])] if data["bounds"] else []),
        *(Text(f"{row['request']} {row['reason']}", "red") for row in data["blocked"]),
        *_failures(data["failures"]),
        *_problems(data["robots"]),
        agreement,
        *_refused(data.get("refused", {})),
        *([] if data.get("secure", True) else [Text("not secure: nothing is signed", "yellow")]),
    )


def _failures(ends: Sequence[Mapping[str, Any]]) -> list[Text]:
    """The latest failures."""
    lines = [failure_line(end) for end in ends[-MOST_FAILURES:]]
    earlier = len(ends) - len(lines)
    return ([Text(f"{earlier} earlier failures", "dim")] if earlier else []) + lines


def _problems(robots: Mapping[str, Any]) -> list[Text]:
    """What is wrong with the programs of the robots."""
    return [
        problem_line({"robot": robot, "subject": subject, "problem": text})
        for robot, row in robots.items()
        for subject, text in row["problems"].items()
    ]


def _refused(counts: Mapping[str, Mapping[str, int]]) -> list[Text]:
    """A line for each robot that has refused anything, with how often for which reason."""
    lines = []
    for robot, rows in counts.items():
        by_reason: Counter[str] = Counter()
        for text, count in rows.items():
            by_reason[text.partition(": ")[2]] += count
        shown = [f"{reason} ({count})" for reason, count in by_reason.most_common(MOST_REASONS)]
        if len(by_reason) > MOST_REASONS:
            shown.append(f"{len(by_reason) - MOST_REASONS} other reasons")
        total = f"{robot} has refused {sum(by_reason.values())} messages: "
        lines.append(Text(total + "; ".join(shown), "yellow"))
    return lines


def _standing(data: Mapping[str, Any]) -> str:
    stands_by = data.get("ends") == "never" and data["result"] in ("success", "failure")
    return ", stands by" if stands_by else ""


def _robots(robots: Mapping[str, Any]) -> Table:
    headings = ("robot", "type", "host", "pid", "state", "works on", "lost or changed")
    table = Table(*headings, box=None, header_style="dim")
    for robot, row in robots.items():
        table.add_row(
            Text(robot, style="bold"),
            row["type"] or "",
            row["host"] or "",
            str(row["pid"] or ""),
            Text(row["state"], style=STATE_MARKS[row["state"]][1]),
            row["local_task"] or Text("nothing", style="dim"),
            capability_changes(row),
        )
    return table


def _tasks(tasks: Mapping[str, Any]) -> list[Text]:
    """A line for each status that some global task has."""
    by_status: dict[str, list[str]] = {}
    for name, task in tasks.items():
        by_status.setdefault(task["status"], []).append(name)
    return [
        Text.assemble((f"{status}:", "dim"), f" {', '.join(by_status[status])}")
        for status in ("running", "success", "failure", "cancelled")
        if status in by_status
    ]
