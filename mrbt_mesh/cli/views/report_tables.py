"""The tables of a report as texts, for HTML and Markdown alike."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from mrbt_mesh.core.observer.episodes import lost_text
from mrbt_mesh.views.report.model import ReportedPlan, RunReport, Wait, WaitKind, spread

# Waits are told that take at least so long, so many of each kind; `--json` has all.
LEAST_WAIT_S, MOST_WAITS = 0.02, 12
WAIT_TITLES = {
    WaitKind.TASK: "Tasks that were requested and not served",
    WaitKind.START: "Robots with a claim that they could not start",
    WaitKind.IDLE: "Robots without a task",
}


@dataclass(frozen=True)
class Table:
    """Headings and rows of texts; `note` stands below, empty: nothing to say."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def seconds(value: float | None) -> str:
    """`12.35 s`; a dash where it is not known."""
    return "–" if value is None else f"{value:.2f} s"


def after(value: float | None) -> str:
    """Milliseconds, for people."""
    if value is None:
        return "–"
    if value >= 10_000:
        return f"{value / 1e3:.1f} s"
    return f"{value:.0f} ms" if value >= 100 else f"{value:.1f} ms"


def percent(value: float | None) -> str:
    """A share as `43 %`."""
    return "–" if value is None else f"{100 * value:.0f} %"


def spread_text(values: Iterable[float | None]) -> str:
    """Median and, of several, the largest."""
    found = spread(values)
    if found is None:
        return "–"
    text = after(found["median"])
    return text if found["least"] == found["most"] else f"{text} (≤ {after(found['most'])})"


def agreement_text(run: RunReport) -> str:
    """How long robots reported different plans, in a few words."""
    if run.differences is None or run.differing_s is None:
        return "–"
    if not run.differences:
        return "always"
    share = 1 - run.differing_s / run.duration_s if run.duration_s > 0 else 1.0
    return f"{100 * max(0.0, share):.2f} %"


def agreement_sentence(run: RunReport) -> str:
    """On how many plans all robots agreed, and how long they differed."""
    plans, found = run.plans or (), run.differences or ()
    agreed = [plan for plan in plans if plan.agreed_s is not None]
    took = spread_text(1e3 * _agreeing_s(plan) for plan in agreed)
    text = f"{len(plans)} plans; all robots agreed on {len(agreed)} of them, after {took}. "
    if not found:
        return text + "They reported the same plan all the time."
    longest_s = max(each.to_s - each.from_s for each in found)
    return text + (
        f"{len(found)} times some reported another plan than most, "
        f"{after(1e3 * (run.differing_s or 0))} in all, {after(1e3 * longest_s)} at most. "
        "A robot starts a task only once those whom it concerns agree."
    )


def fault_table(run: RunReport) -> Table:
    """Deaths and lost capabilities."""
    rows = []
    for fault in run.faults:
        until = "" if fault.until_s is None else f"; back at {seconds(fault.until_s)}"
        what = lost_text(fault.lost, fault.reason) if fault.lost else "died"
        rows.append(
            (
                seconds(fault.at_s),
                fault.robot,
                what + until,
                after(fault.detected_ms) if not fault.lost else "",
                fault.held or "",
                fault.replacement or ("nobody" if fault.held else ""),
                after(fault.taken_over_ms) if fault.held else "",
                fault.why,
            )
        )
    head = (
        "at",
        "robot",
        "fault",
        "detected after",
        "it held",
        "taken over by",
        "after",
        "who could",
    )
    return Table(head, tuple(rows))


def failure_table(run: RunReport) -> Table:
    """Local tasks that failed, and why, as far as robots said it."""
    rows = tuple(
        (seconds(each.at_s), each.robot, each.local_task, each.global_task, each.reason or "–")
        for each in run.failures
    )
    return Table(("at", "robot", "failed at", "for", "why"), rows)


def use_table(run: RunReport) -> Table:
    """What each robot did with its time; without recording only its type and state."""
    if run.work is None:
        return Table(
            ("robot", "type", "state"), tuple((r.robot, r.type, r.state) for r in run.robots)
        )
    rows = tuple(
        (
            each.robot,
            each.type,
            each.state,
            percent(each.utilisation),
            seconds(each.working_s),
            seconds(each.starting_s),
            seconds(max(0.0, each.present_s - each.working_s - each.starting_s)),
            str(each.done),
        )
        for each in run.robots
    )
    head = (
        "robot",
        "type",
        "at the end",
        "utilisation",
        "worked",
        "starting",
        "idle",
        "done",
    )
    return Table(head, rows)


def wait_table(run: RunReport, kind: WaitKind) -> Table:
    """The longest waits of one kind, in the order of their begins; of idle robots, by reason."""
    all_waits = [wait for wait in run.waits or () if wait.kind is kind]
    if kind is WaitKind.IDLE:
        return _idle_table(all_waits)
    told = [wait for wait in all_waits if wait.seconds >= LEAST_WAIT_S]
    told = sorted(told, key=lambda wait: (-wait.seconds, wait.from_s, wait.who))[:MOST_WAITS]
    left = len(all_waits) - len(told)
    left_s = sum(wait.seconds for wait in all_waits) - sum(wait.seconds for wait in told)
    note = f"{left} shorter ones, {left_s:.2f} s together" if left else ""
    told.sort(key=lambda wait: (wait.from_s, wait.who))
    waiter = "global task" if kind is WaitKind.TASK else "robot"
    return Table(("from", "for", waiter, "waited for", "why"), tuple(map(_wait_row, told)), note)


def _idle_table(waits: list[Wait]) -> Table:
    reasons: dict[str, dict[str, float]] = {}
    for wait in waits:
        robots = reasons.setdefault(wait.reason, {})
        robots[wait.who] = robots.get(wait.who, 0.0) + wait.seconds
    totals = sorted(((sum(each.values()), why) for why, each in reasons.items()), reverse=True)
    rows: list[tuple[str, ...]] = []
    for total_s, why in totals:
        if total_s >= LEAST_WAIT_S and len(rows) < MOST_WAITS:
            each = sorted(reasons[why].items())
            who = ", ".join(f"{robot} {value:.1f} s" for robot, value in each)
            rows.append((seconds(total_s), why, who))
    left_s = sum(total for total, _ in totals[len(rows) :])
    left = len(totals) - len(rows)
    note = f"{left} other reasons, {left_s:.2f} s together" if left else ""
    return Table(("for", "why", "robots"), tuple(rows), note)


def _wait_row(wait: Wait) -> tuple[str, ...]:
    whom = ", ".join(wait.robots)
    return (seconds(wait.from_s), seconds(wait.seconds), wait.who, whom or "–", wait.reason)


def task_table(run: RunReport) -> Table:
    """What became of the global tasks that were ever wanted."""
    wanted = [task for task in run.tasks if task.status != "idle"]
    left = len(run.tasks) - len(wanted)
    rows = tuple((task.name, task.status, ", ".join(task.robots)) for task in wanted)
    return Table(
        ("global task", "result", "robots"), rows, f"{left} were not needed" if left else ""
    )


def difference_table(run: RunReport) -> Table:
    """The longest times in which robots reported different plans."""
    found = sorted(run.differences or (), key=lambda each: each.from_s - each.to_s)
    long = [each for each in found if each.to_s - each.from_s >= LEAST_WAIT_S][:MOST_WAITS]
    told = sorted(long, key=lambda each: each.from_s)
    rows = tuple(
        (seconds(each.from_s), after(1e3 * (each.to_s - each.from_s)), ", ".join(each.robots))
        for each in told
    )
    left = len(found) - len(told)
    return Table(("from", "for", "who differed"), rows, f"{left} shorter ones" if left else "")


def plan_table(run: RunReport) -> Table:
    """The plans on which the team agreed last, or not at all, in the order of their begins."""
    plans = run.plans or ()
    slow = sorted(plans, key=lambda plan: (-_agreeing_s(plan), plan.number))[:MOST_WAITS]
    rows = tuple(_plan_row(plan) for plan in sorted(slow, key=lambda plan: plan.number))
    left = len(plans) - len(rows)
    note = f"{left} other plans, on which all agreed sooner" if left else ""
    return Table(("plan", "first reported", "by", "all agreed after", "the last"), rows, note)


def _agreeing_s(plan: ReportedPlan) -> float:
    return math.inf if plan.agreed_s is None else plan.agreed_s - plan.from_s


def _plan_row(plan: ReportedPlan) -> tuple[str, ...]:
    first = [robot for robot, at_s in plan.since_s.items() if at_s == plan.from_s]
    last_s = max(at_s for at_s in plan.since_s.values() if at_s <= (plan.agreed_s or math.inf))
    last = [robot for robot, at_s in plan.since_s.items() if at_s == last_s]
    agreed = "not before the next plan" if plan.agreed_s is None else after(1e3 * _agreeing_s(plan))
    name = f"{plan.number} ({plan.digest})"
    who = ", ".join(last) if last_s > plan.from_s else "–"
    return (name, seconds(plan.from_s), ", ".join(first), agreed, who)


def comparison_table(runs: Iterable[RunReport]) -> Table:
    """Several runs side by side."""
    rows = tuple(
        (
            run.title,
            run.mission,
            run.result if run.verdict is None else f"{run.result}, {run.verdict}",
            seconds(run.duration_s),
            str(len(run.deaths)),
            spread_text(fault.detected_ms for fault in run.deaths),
            spread_text(fault.taken_over_ms for fault in run.deaths),
            percent(run.utilisation),
            seconds(run.waited_s(WaitKind.TASK)),
            agreement_text(run),
        )
        for run in runs
    )
    head = (
        *("run", "mission", "result", "duration", "deaths", "detected after", "taken over after"),
        *("utilisation", "tasks waited", "one plan"),
    )
    return Table(head, rows)
