"""Renders an analysis for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from mrbt_mesh.analysis.tolerance.advice import Additions
from mrbt_mesh.analysis.tolerance.analyse import (
    ASSUMPTIONS,
    Advice,
    Analysis,
    ReadingResult,
    TaskSlack,
    assumptions,
)
from mrbt_mesh.analysis.tolerance.jobs import JobAnalysis
from mrbt_mesh.analysis.tolerance.model import Answer
from mrbt_mesh.analysis.tolerance.service import Fault
from mrbt_mesh.cli.printing import Panel, Printable, Stack, Styled
from mrbt_mesh.cli.terminal import table
from mrbt_mesh.core.mission.mission import majority
from mrbt_mesh.core.mission.names import type_name

MAX_NAMED = 8
MAX_TASKS = 30
READING_NAMES = {
    "serial": "succeeds, serially if need be",
    "keeps_every_task": "can still do every global task",
    "keeps_parallel_width": "keeps its parallel width",
}


def grouped(faults: Iterable[Fault]) -> list[str]:
    """Return robots as they are, and capabilities as `move_frame on C1, C2`."""
    robots = [fault for fault in faults if isinstance(fault, str)]
    holders: dict[str, list[str]] = {}
    for fault in faults:
        if not isinstance(fault, str):
            holders.setdefault(fault[1], []).append(fault[0])
    texts = list(robots)
    for name, owners in sorted(holders.items()):
        texts.append(f"{name} on {shortened(owners)}")
    return texts


def shortened(names: Sequence[str], most: int = MAX_NAMED) -> str:
    """Return the first few of many names."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def faults_text(faults: Iterable[Fault], separator: str = "; ") -> str:
    """Return a set of faults in words; `none` if it is empty."""
    faults = list(faults)
    if not faults:
        return "none"
    texts = grouped(faults)
    if isinstance(faults[0], str):
        return shortened(texts)
    more = f"{separator}and {len(texts) - MAX_NAMED} more" if len(texts) > MAX_NAMED else ""
    return separator.join(texts[:MAX_NAMED]) + more


def figure(answer: Answer, is_most: bool) -> str:
    """Return the figure, or the range in which it is known to be."""
    if answer.is_proved:
        return "-" if answer.value is None else str(answer.value)
    low, high = (answer.value, answer.bound) if is_most else (answer.bound, answer.value)
    return f"{low} to {high}"


def additions_text(found: Additions) -> str:
    """Return `1 x C` or `move_frame for B1`."""
    parts = [f"{count} x {kind}" for kind, count in found.robots.items()]
    parts += [f"{name} for {robot}" for robot, name in found.capabilities]
    return shortened(parts, 6)


def advice_rows(advice: Advice) -> list[tuple[str, str, str]]:
    """Return rows of (way, addition, cost)."""
    rows = []
    for way, found in (
        ("cheapest", advice.cheapest),
        ("robots only", advice.robots_only),
        ("capabilities only", advice.capabilities_only),
    ):
        if found.cost == 0 and found.is_proved:
            return [("", "nothing to add: it is so already", "0")]
        if found.cost is None:
            what = "nothing helps" if found.is_proved else "not found in time"
            rows.append((way, what, "-" if found.is_proved else f"at least {found.bound}"))
        else:
            cost = str(found.cost) if found.is_proved else f"{found.bound} to {found.cost}"
            rows.append((way, additions_text(found), cost))
    return rows


def task_groups(tasks: Sequence[TaskSlack]) -> list[tuple[str, TaskSlack]]:
    """Return tasks of one type with the same figures as one row: `diagnose_part (5 alike)`."""
    rows: dict[object, list[TaskSlack]] = {}
    for each in tasks:
        needs = tuple((type_name(name), least, able) for name, least, able in each.needs)
        key = (type_name(each.task), each.slack, needs, each.is_indispensable)
        rows.setdefault(key, []).append(replace(each, needs=needs))
    return [
        (f"{type_name(group[0].task)} ({len(group)} alike)", group[0])
        if len(group) > 1
        else (group[0].task, group[0])
        for group in rows.values()
    ]


def render_analysis(analysis: Analysis) -> Printable:
    """Return the whole report."""
    parts: list[Printable] = [_headline(analysis)]
    assumed = assumptions(analysis.mission)
    remarks = [Styled(assumed[0], "yellow")] if assumed is not ASSUMPTIONS else []
    for name, result in analysis.readings.items():
        if result.question.obstacle:
            remarks.append(Styled(f"{READING_NAMES[name]}: {result.question.obstacle}", "red"))
    sections: dict[str, list[Printable]] = {
        "How many faults": [_figures(analysis), *remarks],
        "Which faults": [_examples(analysis.main)],
        "Slack: robots that a global task can lose, whichever they are": [_tasks(analysis)],
        "Advice: what to add": [_advice(analysis)],
        "Cautions": [Styled(f"- {line}", "yellow") for line in analysis.cautions],
        "Assumed": [Styled(f"- {line}", "dim") for line in assumed],
    }
    for title, rows in sections.items():
        if rows:
            parts += ["", Styled(title, "bold"), *rows]
    if not analysis.is_complete:
        text = "Time ran out: ranges hold the true figures; a larger --limit narrows them."
        parts += ["", Styled(text, "yellow")]
    return Stack(*parts)


def render_jobs(mission: str, jobs: Sequence[JobAnalysis]) -> Printable:
    """Return a summary of what a job of each type survives, and the report of each."""
    heading = (
        "a job of type",
        "survives any one robot",
        "any one capability",
        "fatal alone",
        "scarce",
    )
    short = table(*heading)
    for each in jobs:
        main = each.analysis.main
        fatal = faults_text(main.major.critical)
        marks = _mark(main.is_strong), _mark(main.is_weak)
        short.add_row(each.type, *marks, fatal, shortened(each.scarce))
    text = f"{mission}: each type of jobs on its own, with the arguments that survive least"
    reports = [part for each in jobs for part in ("", render_analysis(each.analysis))]
    return Stack(Styled(text, "bold"), short, *reports)


def _mark(value: bool | None) -> Styled:
    if value is None:
        return Styled("not known", "yellow")
    return Styled("yes", "bold green") if value else Styled("no", "bold red")


def _headline(analysis: Analysis) -> Printable:
    main = analysis.main
    capabilities = main.minor.total
    text = Styled.assemble(
        (analysis.mission.name, "bold"),
        f"   {len(analysis.mission.robots)} robots, {capabilities} capabilities\n",
        "survives the loss of any one capability (weakly fault tolerant)  ",
        _mark(main.is_weak),
        "\nsurvives the loss of any one robot (strongly fault tolerant)     ",
        _mark(main.is_strong),
    )
    return Panel(text, "green" if main.is_strong else "red")


def _figures(analysis: Analysis) -> Printable:
    rows = table("the mission ...", "faults", "of", "survives", "fatal from", right=range(2, 5))
    for name, result in analysis.readings.items():
        for kind, found in (("robots", result.major), ("capabilities", result.minor)):
            rows.add_row(
                READING_NAMES[name] if kind == "robots" else "",
                kind,
                str(found.total),
                Styled(figure(found.max_tolerated, True), "green"),
                Styled(figure(found.min_fatal, False), "red"),
            )
    return rows


def _examples(main: ReadingResult) -> Printable:
    rows = table("", "robots", "capabilities")
    for title, major, minor in (
        ("fatal alone", main.major.critical, main.minor.critical),
        ("fatal together, fewest", main.major.min_fatal.chosen, main.minor.min_fatal.chosen),
        (
            "survived together, most",
            main.major.max_tolerated.chosen,
            main.minor.max_tolerated.chosen,
        ),
    ):
        rows.add_row(title, faults_text(major), faults_text(minor, "\n"))
    return rows


def _tasks(analysis: Analysis) -> Printable:
    listed = table("global task", "slack", "needs (of capable robots)", "", right=(1,))
    rows = sorted(task_groups(analysis.tasks), key=lambda row: row[1].slack)
    for name, each in rows[:MAX_TASKS]:
        style = "red" if each.slack <= 0 else "green"
        needs = ", ".join(f"{least} of {able} {task}" for task, least, able in each.needs)
        notes = [] if each.is_indispensable else ["has alternatives"]
        if each.is_exclusive:
            robots = analysis.mission.robots
            notes.append(f"exclusive: {majority(robots)} of {len(robots)} robots grant it")
        listed.add_row(name, Styled(str(each.slack), style), needs, Styled(", ".join(notes), "dim"))
    if len(rows) > MAX_TASKS:
        listed.add_row(Styled(f"and {len(rows) - MAX_TASKS} more rows: --json", "dim"))
    return listed


def _advice(analysis: Analysis) -> Printable:
    rows = table("to make it", "", "add", "cost")
    for name, advice in (("weakly", analysis.weak_advice), ("strongly", analysis.strong_advice)):
        for number, (way, addition, cost) in enumerate(advice_rows(advice)):
            rows.add_row(f"{name} fault tolerant" if number == 0 else "", way, addition, cost)
    return rows
