"""The status of a team as people read it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from mrbt_mesh.cli.printing import Printable, Stack, Styled
from mrbt_mesh.cli.terminal import table
from mrbt_mesh.cli.views.marks import STATE_MARKS, STATE_WORDS, by_urgency, statement_text
from mrbt_mesh.cli.views.plan_view import render_bounds, render_forecast
from mrbt_mesh.cli.views.summary_view import (
    MOST_FAILURES,
    capability_changes,
    failure_line,
)
from mrbt_mesh.core.mission.names import with_entries
from mrbt_mesh.observer.time_at_work import time_text

# Reasons of refusals that are named for each robot; `--json` has all.
MOST_REASONS = 5


def render_status(data: Mapping[str, Any]) -> Printable:
    """The output of `mrbt status --json`, for a terminal."""
    robots = table("robot", "type", "host", "pid", "state", "works on", "for", "faults")
    for robot in by_urgency(data["robots"]):
        row = data["robots"][robot]
        robots.add_row(
            Styled(robot, "bold"),
            row["type"] or "",
            row["host"] or "",
            str(row["pid"] or ""),
            Styled(STATE_WORDS.get(row["state"], row["state"]), STATE_MARKS[row["state"]][1]),
            _works_on(row),
            _for(row),
            capability_changes(row),
        )
    name = data["mission"] + (f", revision {data['revision']}" if data["revision"] else "")
    parts: list[Printable] = [Styled(name, "bold")]
    parts += [Styled.assemble("  ", statement_text(each)) for each in data["headline"]]
    parts.append(robots)
    if data["forecast"] is not None:
        parts.append(render_forecast(data["forecast"]))
    for status in ("running", "success", "failure", "cancelled"):
        names = [name for name, row in data["global_tasks"].items() if row["status"] == status]
        if names:
            parts.append(Styled.assemble((f"{status}:", "dim"), f" {', '.join(names)}"))
    if data["blackboard"]:
        values = ", ".join(f"{name} = {value}" for name, value in data["blackboard"].items())
        parts.append(Styled.assemble(("blackboard:", "dim"), f" {values}"))
    if data["bounds"]:
        parts.append(render_bounds(data["bounds"]))
    latest = data["failures"][-MOST_FAILURES:]
    if len(latest) < len(data["failures"]):
        parts.append(Styled(f"{len(data['failures']) - len(latest)} earlier failures", "dim"))
    parts += map(failure_line, latest)
    parts += [_refused(robot, counts) for robot, counts in data.get("refused", {}).items()]
    if not data.get("secure", True):
        parts.append(Styled("not secure: nothing is signed", "yellow"))
    return Stack(*parts)


def _works_on(row: Mapping[str, Any]) -> Styled:
    if not row["local_task"]:
        return Styled("nothing", "dim")
    place = row["under_way"]
    task = with_entries(row["local_task"], {n: v for n, v in row["values"].items() if v})
    return Styled.assemble(task, (f" (on its way to {place})" if place else "", "dim"))


def _for(row: Mapping[str, Any]) -> Styled:
    """For how long it has been at work, of how long that should take."""
    if row["at_work_s"] is None:
        return Styled()
    style = "yellow" if row["is_overdue"] else "dim"
    return Styled(time_text(row["at_work_s"], row["expected_s"]), style, no_wrap=True)


def _refused(robot: str, counts: Mapping[str, int]) -> Styled:
    """How often a robot has refused messages, for which reasons; `counts`: by "source: reason"."""
    by_reason: Counter[str] = Counter()
    for text, count in counts.items():
        by_reason[text.partition(": ")[2]] += count
    shown = [f"{reason} ({count})" for reason, count in by_reason.most_common(MOST_REASONS)]
    if len(by_reason) > MOST_REASONS:
        shown.append(f"{len(by_reason) - MOST_REASONS} other reasons")
    total = f"{robot} has refused {by_reason.total()} messages: "
    return Styled(total + "; ".join(shown), "yellow")
