"""A plan as people read it: the tree, the assignments with reasons, waiting requests, bids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mrbt_mesh.cli.printing import Printable, Stack, Styled, Table
from mrbt_mesh.cli.terminal import table
from mrbt_mesh.cli.views.tree_view import render_tree
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.planning.plan import (
    Plan,
    RobotAssignment,
    assignment_reason,
)
from mrbt_mesh.features.bids.plan import Bidding, biddings


def render_plan(
    mission: Mission, plan: Plan, problem: Mapping[str, Any], idle: Mapping[str, str]
) -> Printable:
    """The whole plan for a terminal. `problem`: its `bounds`, `objective` and `forecast`."""
    workers: dict[str, list[str]] = {}
    for robot, own in plan.assignments.items():
        workers.setdefault(own.activation, []).append(robot)
    waiting = {w.activation: w for w in plan.waiting}
    notes = {}
    for request in plan.evaluation.requests:
        if request.activation in waiting:
            blocked = waiting[request.activation].is_blocked
            style = "red" if blocked else "yellow"
            notes[request.node] = Styled(waiting[request.activation].reason, style=style)
        else:
            robots = ", ".join(workers.get(request.activation, []))
            notes[request.node] = Styled(robots, "bold") if robots else _later(plan, request)
    parts: list[Printable] = [_lines(plan, idle)]
    if plan.demands:
        parts += ["", render_bounds(problem["bounds"])]
        parts.append(Styled(f"objective, the sum of performances: {problem['objective']:g}", "dim"))
    if biddings(plan):
        parts += ["", _bids(plan)]
    if problem["forecast"] is not None:
        parts += ["", render_forecast(problem["forecast"])]
    result = Styled(f"mission: {plan.result.name.lower()}", "bold")
    tree = render_tree(plan.evaluation.tree, plan.evaluation, notes)
    return Stack(tree, "", *parts, "", result)


def _later(plan: Plan, request: Request) -> Styled:
    """The robots that a schedule has on a request later."""
    step = plan.ahead.step_of(request.activation) if plan.ahead is not None else None
    if plan.ahead is None or step is None:
        return Styled()
    return Styled(f"later: {', '.join(plan.ahead.members(step))}", "dim")


def render_bounds(bounds: Sequence[Mapping[str, Any]]) -> Table:
    """a_j and b_j of each demand (`DemandBounds.to_json`), its robots and performances."""
    performances = ["performance"] if any("performances" in row for row in bounds) else []
    rows = table("local task", "for", "min", "max", "robots", *performances)
    for row in bounds:
        robots = ", ".join(row["robots"]) or Styled("nobody", "dim")
        numbers = str(row["lower"]), str(row["upper"])
        values = row.get("performances", {})
        able = ", ".join(f"{robot} {p:g}" for robot, p in values.items())
        more = [Styled(able, "dim")] if performances else []
        rows.add_row(row["local_task"], row["global_task"], *numbers, robots, *more)
    return rows


def render_forecast(forecast: Mapping[str, Any]) -> Printable:
    """Where each robot is, and what is next (`Forecast.to_json`)."""
    rows = table("robot", "is at", "next")
    for name, robot in forecast["robots"].items():
        rows.add_row(
            Styled(name, "bold"), robot["where"], robot["next"] or Styled("nothing", "dim")
        )
    left_out = [f"not scheduled: {x['global_task']}: {x['reason']}" for x in forecast["left_out"]]
    texts = [Styled(forecast["text"]), *(Styled(each, "yellow") for each in left_out)]
    return Stack(rows, *texts)


def _lines(plan: Plan, idle: Mapping[str, str]) -> Table:
    """The assignment of each robot, with its reason."""
    rows = table("robot", "does", "for", "why")
    for robot in sorted({*plan.assignments, *plan.idle}):
        line = plan.assignments.get(robot)
        if line is None:
            rows.add_row(robot, Styled("nothing", "dim"), "", Styled(idle[robot], "dim"))
            continue
        why = assignment_reason(plan, robot)
        rows.add_row(Styled(robot, "bold"), line.local_task, line.global_task, Styled(why, "dim"))
    return rows


def _bids(plan: Plan) -> Table:
    """The bids, the best first and the chosen in bold, and the robots without one."""
    rows = table("local task", "for", "bids")
    for bidding in biddings(plan):
        made = {robot: bid for robot, bid in bidding.bids.items() if bid is not None}
        texts = [
            Styled(f"{robot} {made[robot] / MICRO:g}", _style(plan.assignments.get(robot), bidding))
            for robot in sorted(made, key=lambda robot: (-made[robot], robot))
        ]
        none = [robot for robot, bid in bidding.bids.items() if bid is None]
        if none:
            texts.append(Styled(f"none of {', '.join(none)}", "dim"))
        if bidding.silent:
            word = "waiting for" if bidding.is_open else "nothing from"
            texts.append(Styled(f"{word} {', '.join(bidding.silent)}", "yellow"))
        rows.add_row(bidding.local_task, bidding.global_task, Styled(", ").join(texts))
    return rows


def _style(line: RobotAssignment | None, bidding: Bidding) -> str:
    place = (bidding.activation, bidding.local_task)
    return "bold" if line is not None and (line.activation, line.local_task) == place else "dim"
