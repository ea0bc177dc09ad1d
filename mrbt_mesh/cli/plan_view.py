"""A plan as people read it: the tree, who does what and why, what waits."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from mrbt_mesh.cli.tree_view import render_tree
from mrbt_mesh.core.mission import MICRO, Mission
from mrbt_mesh.core.plan import Plan


def render_plan(mission: Mission, plan: Plan) -> RenderableType:
    """The whole plan for a terminal."""
    workers: dict[str, list[str]] = {}
    for robot, own in plan.lines.items():
        workers.setdefault(own.activation, []).append(robot)
    waiting = {w.activation: w for w in plan.waiting}
    notes = {}
    for request in plan.evaluation.requests:
        if request.activation in waiting:
            blocked = waiting[request.activation].is_blocked
            style = "red" if blocked else "yellow"
            notes[request.node] = Text(waiting[request.activation].reason, style=style)
        else:
            robots = ", ".join(workers.get(request.activation, []))
            notes[request.node] = Text(robots, style="bold")
    table = Table("robot", "does", "for", "why", box=None, header_style="dim", pad_edge=False)
    for robot in sorted({*plan.lines, *plan.idle}):
        line = plan.lines.get(robot)
        if line is None:
            table.add_row(robot, Text("nothing", style="dim"), "", Text(plan.idle[robot], "dim"))
            continue
        why = "goes on with what it runs" if line.pinned else "part of the best assignment"
        why += f" (performance {line.performance / MICRO:g})"
        table.add_row(Text(robot, "bold"), line.local_task, line.global_task, Text(why, "dim"))
    result = Text(f"mission: {plan.result.name.lower()}", style="bold")
    return Group(render_tree(mission.tree, plan.evaluation, notes), "", table, "", result)
