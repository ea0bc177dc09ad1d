"""Drills as people read them: a list, the events of one, its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mrbt_mesh.cli.printing import Styled, Table
from mrbt_mesh.cli.terminal import table
from mrbt_mesh.cli.views.summary_view import takeover_after
from mrbt_mesh.drills.drill_file import Drill
from mrbt_mesh.drills.judge import DrillResult
from mrbt_mesh.drills.report import report_data
from mrbt_mesh.drills.runner import DrillRun, TimelineEntry


def render_list(drills: Sequence[Drill]) -> Table:
    """Return one row per drill file."""
    listed = table("drill", "runs", "needs", "", "what happens")
    by_file: dict[Path, list[Drill]] = {}
    for found in drills:
        by_file.setdefault(found.path, []).append(found)
    for group in by_file.values():
        model = group[0].model
        listed.add_row(
            Styled(model.name, "bold"),
            str(len(group) * len(model.profiles)),
            model.network if model.network != "loopback" else "",
            "quick" if model.quick else "",
            Styled(" ".join(model.description.split()).partition(". ")[0].rstrip(".")),
        )
    return listed


def line_text(line: TimelineEntry) -> Styled:
    """Return one line of a drill's timeline."""
    style = "red" if line.is_fault or line.text == "is dead" else ""
    return Styled.assemble(
        (f"{line.at_s:9.3f}  ", "dim"), (f"{line.robot:5} ", "bold"), (line.text, style)
    )


def takeover_text(takeover: Mapping[str, Any]) -> Styled:
    """Return how a robot was missed and replaced."""
    line = Styled.assemble("  ", ("↻ ", "yellow"), (str(takeover["robot"]), "bold"))
    if not takeover["inflicted"]:
        return line.append(f" held dead by others at {takeover['at_s']:.3f} s")
    line.append(f" lost at {takeover['at_s']:.3f} s")
    line.append(f", detected after {takeover_after(takeover, 'detected_s')}")
    if takeover["held"]:
        line.append(f", while on {takeover['held']}")
    if takeover["replacement"]:
        after = takeover_after(takeover, "reassigned_s")
        line.append(f", taken over by {takeover['replacement']} after {after}")
    return line


def result_text(result: DrillResult) -> Styled:
    """Return an expectation and whether it held."""
    sign, style = ("✔", "green") if result.holds else ("✘", "bold red")
    return Styled.assemble(
        "  ", (f"{sign} ", style), (result.expected, "" if result.holds else "red"),
        (f": {result.found}", "dim" if result.holds else "red"),
    )  # fmt: skip


def headline(run: DrillRun) -> Styled:
    """Return the result of a run in one line."""
    if run.skipped is not None:
        return Styled(f"skipped: {run.skipped}", "yellow")
    text = Styled("green", "bold green") if run.is_green else Styled("red", "bold red")
    text.append(f" in {run.duration_s:.1f} s", "dim")
    wrong = [result for result in run.results if not result.holds]
    for result in wrong:
        text.append(f"; {result.expected}: {result.found}", "red")
    return text


def render_total(runs: Sequence[DrillRun]) -> Styled:
    """Return the results of all runs in one line."""
    data = report_data(runs)
    seconds = sum(run.duration_s for run in runs)
    return Styled.assemble(
        (f"{data['green']} green", "bold green"),
        (f", {data['red']} red", "bold red" if data["red"] else "dim"),
        (f", {data['skipped']} skipped", "yellow" if data["skipped"] else "dim"),
        (f" in {seconds:.0f} s", "dim"),
    )
