"""A report as one self-contained HTML file: no scripts, no fonts, no network."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any, TypeVar

from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.episodes import after_text, lost_text
from mrbt_mesh.views.report.gantt import HUES, gantt, kinds
from mrbt_mesh.views.report.model import (
    NOT_KNOWN,
    RUNNING,
    Disagreement,
    ReportedFault,
    ReportedPlan,
    RunParts,
    RunReport,
    Wait,
    WaitKind,
    spread,
)

_FIRST_LINE = "<!DOCTYPE html>"
STYLE = Path(__file__).with_name("style.css")
# Shorter waits and disagreements are counted together, like those beyond the longest `MOST_ROWS`;
# `--json` lists all.
LEAST_S, MOST_ROWS, MOST_JOBS = 0.02, 12, 200
WAITS = {
    WaitKind.TASK: "Tasks that were requested and not served",
    WaitKind.START: "Robots with a claim that they could not start",
    WaitKind.IDLE: "Robots without a task",
}
CHIPS = {"success": "good", "failure": "bad"}
SIGNS = {"good": "✔", "bad": "✘", "": "…"}
# Columns with sentences; texts longer than `LONGEST` letters get a wider column.
SENTENCES, LONGEST = ("why", "who could"), 100
# Cells of a table that begin with a bar: (row, column) -> its length from 0 to 1.
Bars = Mapping[tuple[int, int], float]
_Lasting = TypeVar("_Lasting", Wait, Disagreement)


def check_page(path: Path) -> None:
    """Raise InputError if this is a file already, and not a page that may be written anew."""
    if not os.path.lexists(path):
        return
    try:
        if not path.is_symlink() and path.is_file():
            with path.open("rb") as file:
                if file.read(len(_FIRST_LINE)) == _FIRST_LINE.encode():
                    return
    except OSError as error:
        raise InputError(f"-o {path}: cannot be read: {error.strerror or error}") from None
    raise InputError(f"-o {path}: is there, and is not a page of a report: name another file")


def report_html(report: RunParts) -> str:
    """Return the whole page."""
    title = report.runs[0].title
    parts = map(_run, report.runs)
    return (
        f'{_FIRST_LINE}\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}: report</title>\n"
        f"<style>\n{STYLE.read_text(encoding='utf-8')}</style></head>\n"
        f"<body><main>\n{''.join(parts)}\n</main></body></html>\n"
    )


def _run(run: RunReport) -> str:
    about = "" if run.title == run.mission else f'<span class="soft">{escape(run.mission)}</span>'
    parts = [
        _header(run.title, about + _chip(run.result)),
        "".join(f'<p class="soft">Note: {escape(note)}.</p>' for note in run.notes),
        _identity(run),
        _cards(run),
        _section("Who did what when", _chart(run)),
        _section("Jobs", _jobs(run)),
        _section("Faults", _faults(run) or _none(_no_faults(run))),
        _section("What operators commanded", _commands(run)),
        _section("Failures", _failures(run)),
        _pair(_section("Robots", _robots(run)), _section("Global tasks", _tasks(run))),
        _section("Scheduled and done", _scheduled(run)),
        _section("What waited for whom", _waits(run)),
        _section("Agreement", _agreement(run)),
        _section("Verification", _proof(run)),
    ]
    return "\n".join(part for part in parts if part)


def _no_faults(run: RunReport) -> str:
    if names := _not_known(run):
        return f"None is recorded; whether {', '.join(names)} died is not known."
    return "No robot died or lost a capability."


def _not_known(run: RunReport) -> list[str]:
    return [each.robot for each in run.robots if each.state == NOT_KNOWN]


def _identity(run: RunReport) -> str:
    """Return the section on which run it was, and when."""
    known = run.identity
    if known is None:
        return ""
    rows = [("run", known.run), ("mission digest", known.mission_digest), ("mrbt", known.version)]
    if known.began_unix_s is not None:
        end = _clock(run, run.duration_s)
        rows.insert(0, ("when", f"{_date(known.began_unix_s)} {_clock(run, 0.0)} to {end} UTC"))
    else:
        rows.insert(0, ("when", "simulated, in virtual time"))
    if run.proof is not None:
        rows.append(("mrbt recording verify", run.proof.result))
    listed = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in rows)
    return f'<dl class="identity">{listed}</dl>'


def _date(unix_s: float) -> str:
    return f"{datetime.fromtimestamp(unix_s, UTC):%Y-%m-%d}"


def _clock(run: RunReport, at_s: float | None) -> str:
    """The wall-clock time of a second of the run, in UTC, to the millisecond."""
    if run.identity is None or run.identity.began_unix_s is None or at_s is None:
        return "–"
    time = datetime.fromtimestamp(run.identity.began_unix_s + at_s, UTC)
    return f"{time:%H:%M:%S}.{time.microsecond // 1000:03d}"


def _commands(run: RunReport) -> str:
    if run.proof is None:
        return ""
    rows = (
        (_seconds(c.at_s), _clock(run, c.at_s), c.by, c.command, c.signer or "not proved")
        for c in run.commands
    )
    table = _table(("at", "clock (UTC)", "by", "command", "signed by"), rows)
    return table or _none("No command and no view commanded anything in this run directory.")


def _proof(run: RunReport) -> str:
    """Return the section on the findings of `mrbt recording verify`."""
    proof = run.proof
    if proof is None:
        return ""
    counts = ", ".join(f"{count:,} {name}" for name, count in proof.counts.items())
    text = f"{len(proof.recordings)} recordings: {proof.result}. Checked: {counts}."
    key = f"Signed by the team whose key is {proof.team_key[:16]}." if proof.team_key else ""
    basis = _none(key or "Without keys everything can be forged.")
    shown = "".join(
        _table((name,), ((each,) for each in found[:MOST_ROWS]))
        for name, found in (("contradicted", proof.findings), ("not proved", proof.gaps))
    )
    left = sum(max(0, len(found) - MOST_ROWS) for found in (proof.findings, proof.gaps))
    more = _none(f"{left} more: see mrbt recording verify") if left else ""
    return f"<p>{escape(text)}</p>{basis}{shown}{more}"


def _none(text: str) -> str:
    return f'<p class="soft">{escape(text)}</p>'


def _cards(run: RunReport) -> str:
    held = [fault for fault in run.deaths if fault.held]
    taken = [fault for fault in held if fault.replacement]
    died, lost = len(run.deaths), len(run.faults) - len(run.deaths)
    cards = [
        (_seconds(run.duration_s), f"from the first robot's joining {_until(run)}"),
        (f"{died} + {lost}", "deaths (major faults) and losses of capabilities (minor)"),
    ]
    if names := _not_known(run):
        cards.append((f"{len(names)}", "robots whose end is not known"))
    if died:
        cards.append((_detected(run), "until a death was detected"))
        words = f"until its task ran again: {len(taken)} of {len(held)} taken over"
        cards.append((_taken_over(run), words))
    if run.work is not None:
        cards.append((_percent(run.utilisation), "utilisation of the robots while they lived"))
    if run.differences is not None:
        cards.append((_agreed_share(run), "of the time all robots reported the same plan"))
    listed = "".join(
        f'<div class="card"><b>{escape(value)}</b><i>{escape(text)}</i></div>'
        for value, text in cards
    )
    return f'<div class="cards">{listed}</div>'


def _until(run: RunReport) -> str:
    """Until when the run is reported."""
    if run.result in (NOT_KNOWN, RUNNING):
        return "to the last record"
    return "to the result" if run.result in CHIPS else "to the end"


def _chart(run: RunReport) -> str:
    chart = gantt(run)
    if not chart:
        return ""
    keys = [(f"h{n % HUES}", kind) for n, kind in enumerate(kinds(run))]
    keys += [("starting", "claimed, not started")]
    if run.deaths:
        keys += [("away", "dead"), ("takeover", "taken over (arrow)")]
    legend = "".join(
        f'<span><span class="key {name}"></span>{escape(text)}</span>' for name, text in keys
    )
    lost = " ▲ lost a capability" if any(fault.lost for fault in run.faults) else ""
    signs = f"<span>✝ died ✘ failed ┤ not needed any more{lost}</span>"
    return f'{_wide(chart, "Gantt chart")}<div class="legend">{legend}{signs}</div>'


def _jobs(run: RunReport) -> str:
    """Return the table of jobs: what was asked for, when, and who did it."""
    head = ("job", "what", "priority", "submitted", "begun", "ended", "by", "how")
    rows = (
        (
            each.id,
            each.call,
            "–" if each.priority is None else str(each.priority),
            _seconds(each.submitted_s),
            _seconds(each.begun_s),
            _seconds(each.ended_s),
            ", ".join(each.robots) or "–",
            each.state + (f": {each.why}" if each.why else ""),
        )
        for each in run.jobs[:MOST_JOBS]
    )
    left = len(run.jobs) - MOST_JOBS
    return _table(head, rows, f"{left} later ones: see --json" if left > 0 else "")


def _faults(run: RunReport) -> str:
    """Return the table of deaths and lost capabilities."""
    head = ("at", "clock (UTC)", "robot", "fault", "detected after", "it held", "taken over by")
    rows = (_fault_row(run, fault) for fault in run.faults)
    return _table((*head, "after", "who could"), rows)


def _fault_row(run: RunReport, fault: ReportedFault) -> tuple[str, ...]:
    until = "" if fault.until_s is None else f"; back at {_seconds(fault.until_s)}"
    return (
        _seconds(fault.at_s),
        _clock(run, fault.at_s),
        fault.robot,
        (lost_text(fault.lost, fault.reason) if fault.lost else "died") + until,
        "" if fault.lost else _after(fault.detected_us, fault.exact),
        fault.held or "",
        fault.replacement or ("nobody" if fault.held else ""),
        _after(fault.taken_over_us, fault.exact) if fault.held else "",
        fault.why,
    )


def _failures(run: RunReport) -> str:
    """Return the table of failed local tasks, with reasons as far as programs gave them."""
    rows = (
        (_seconds(each.at_s), each.robot, each.local_task, each.global_task, each.reason or "–")
        for each in run.failures
    )
    return _table(("at", "robot", "failed at", "for", "why"), rows)


def _robots(run: RunReport) -> str:
    """Return the table of how each robot spent its time.

    From a summary, only its type and state.
    """
    if run.work is None:
        return _table(("robot", "type", "state"), ((r.robot, r.type, r.state) for r in run.robots))
    rows = [
        (
            each.robot,
            each.type,
            each.state,
            _percent(each.utilisation),
            _seconds(each.working_s),
            _seconds(each.starting_s),
            _seconds(max(0.0, each.present_s - each.working_s - each.starting_s)),
            str(each.done),
        )
        for each in run.robots
    ]
    head = ("robot", "type", "at the end", "utilisation", "worked", "starting", "idle", "done")
    bars = {(n, 3): robot.utilisation or 0.0 for n, robot in enumerate(run.robots)}
    return _table(head, rows, bars=bars)


def _tasks(run: RunReport) -> str:
    """Return the table of results of the global tasks that were ever needed."""
    needed = [task for task in run.tasks if task.status != "idle"]
    left = len(run.tasks) - len(needed)
    rows = ((task.name, task.status, ", ".join(task.robots)) for task in needed)
    note = f"{left} were not needed" if left else ""
    return _table(("global task", "result", "robots"), rows, note)


def _scheduled(run: RunReport) -> str:
    """Return the table of tasks, each as predicted by the last schedule with it when that took
    effect.
    """
    rows = (
        (
            each.name,
            f"{each.author or 'rules'} at {_seconds(each.known_s)}",
            ", ".join(each.robots),
            f"{_seconds(each.begins_s)} to {_seconds(each.ends_s)}",
            ", ".join(each.done_by) or "nobody",
            f"{_seconds(each.began_s)} to {_seconds(each.ended_s)}",
            "–" if each.ended_s is None else f"{each.ended_s - each.ends_s:+.1f} s",
        )
        for each in run.scheduled
    )
    return _table(("task", "schedule by", "for", "expected", "done by", "done", "late"), rows)


def _waits(run: RunReport) -> str:
    if run.waits is None:
        return ""
    parts = []
    for kind, title in WAITS.items():
        waits = [wait for wait in run.waits if wait.kind is kind]
        table = _idle(waits) if kind is WaitKind.IDLE else _longest_waits(kind, waits)
        if table:
            parts.append(_subsection(f"{title}: {_seconds(run.waited_s(kind))} together", table))
    return "".join(parts) or '<p class="soft">Nothing waited.</p>'


def _longest_waits(kind: WaitKind, waits: list[Wait]) -> str:
    shown = _longest(waits, lambda wait: (wait.from_s, wait.who))
    left = len(waits) - len(shown)
    left_s = sum(wait.seconds for wait in waits) - sum(wait.seconds for wait in shown)
    rows = (
        (_seconds(w.from_s), _seconds(w.seconds), w.who, ", ".join(w.robots) or "–", w.reason)
        for w in shown
    )
    who = "global task" if kind is WaitKind.TASK else "robot"
    note = f"{left} shorter ones, {left_s:.2f} s together" if left else ""
    return _table(("from", "for", who, "waited for", "why"), rows, note)


def _longest(found: Sequence[_Lasting], order: Callable[[_Lasting], Any]) -> list[_Lasting]:
    """Return at most `MOST_ROWS` items that last at least `LEAST_S`, in this order."""
    longest = sorted(found, key=lambda each: (-each.seconds, order(each)))[:MOST_ROWS]
    return sorted((each for each in longest if each.seconds >= LEAST_S), key=order)


def _idle(waits: list[Wait]) -> str:
    """Return the table of how long robots were idle, by reason."""
    reasons: dict[str, dict[str, float]] = {}
    for wait in waits:
        robots = reasons.setdefault(wait.reason, {})
        robots[wait.who] = robots.get(wait.who, 0.0) + wait.seconds
    totals = sorted(((sum(each.values()), why) for why, each in reasons.items()), reverse=True)
    rows = [
        (
            _seconds(total_s),
            why,
            ", ".join(f"{r} {s:.1f} s" for r, s in sorted(reasons[why].items())),
        )
        for total_s, why in totals[:MOST_ROWS]
        if total_s >= LEAST_S
    ]
    left = totals[len(rows) :]
    left_s = sum(total_s for total_s, _ in left)
    note = f"{len(left)} other reasons, {left_s:.2f} s together" if left else ""
    return _table(("for", "why", "robots"), rows, note)


def _agreement(run: RunReport) -> str:
    """Return the section on how many plans all robots agreed on, and how long they differed."""
    if run.differences is None:
        return ""
    plans = run.plans or ()
    agreed = [plan for plan in plans if plan.agreed_s is not None]
    took = _spread(1e3 * _agreeing_s(plan) for plan in agreed)
    text = f"{len(plans)} plans; all robots agreed on {len(agreed)} of them, after {took}. "
    if run.differences:
        longest_s = max(each.seconds for each in run.differences)
        text += (
            f"{len(run.differences)} times some reported another plan than most, "
            f"{_ms(1e3 * (run.differing_s or 0))} in all, {_ms(1e3 * longest_s)} at most. "
            "A robot starts a task only once those whom it concerns agree."
        )
    else:
        text += "They reported the same plan all the time."
    return (
        f"<p>{escape(text)}</p>"
        + _subsection("Plans on which the team agreed last", _slow_plans(plans))
        + _subsection("Longest times with different plans", _differences(run))
    )


def _slow_plans(plans: Sequence[ReportedPlan]) -> str:
    """Return the table of the plans with the slowest agreement, or none, by their begin."""
    slow = sorted(plans, key=lambda plan: (-_agreeing_s(plan), plan.number))[:MOST_ROWS]
    rows = []
    for plan in sorted(slow, key=lambda plan: plan.number):
        until_s = math.inf if plan.agreed_s is None else plan.agreed_s
        last_s = max(at_s for at_s in plan.since_s.values() if at_s <= until_s)
        first = [robot for robot, at_s in plan.since_s.items() if at_s == plan.from_s]
        last = [robot for robot, at_s in plan.since_s.items() if at_s == last_s > plan.from_s]
        agreed = "not before the next plan"
        if plan.agreed_s is not None:
            agreed = _ms(1e3 * _agreeing_s(plan))
        name = f"{plan.number} ({plan.digest})"
        rows.append((name, _seconds(plan.from_s), ", ".join(first), agreed, ", ".join(last) or "–"))
    left = len(plans) - len(rows)
    note = f"{left} other plans, on which all agreed sooner" if left else ""
    return _table(("plan", "first reported", "by", "all agreed after", "the last"), rows, note)


def _differences(run: RunReport) -> str:
    """Return the table of the longest times in which robots reported different plans."""
    found = run.differences or ()
    shown = _longest(found, lambda each: each.from_s)
    rows = (
        (_seconds(each.from_s), _ms(1e3 * each.seconds), ", ".join(each.robots)) for each in shown
    )
    left = len(found) - len(shown)
    note = f"{left} shorter ones" if left and shown else ""
    return _table(("from", "for", "who differed"), rows, note)


def _agreeing_s(plan: ReportedPlan) -> float:
    return math.inf if plan.agreed_s is None else plan.agreed_s - plan.from_s


def _agreed_share(run: RunReport) -> str:
    """Return the share of the run in which all robots reported the same plan."""
    if run.differences is None or run.differing_s is None:
        return "–"
    if not run.differences:
        return "always"
    share = 1 - run.differing_s / run.duration_s if run.duration_s > 0 else 1.0
    return f"{100 * max(0.0, share):.2f} %"


def _seconds(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.2f} s" if value >= 0 else f"{-value:.2f} s before"


def _ms(value: float | None) -> str:
    return _after(None if value is None else round(1e3 * value), exact=True)


def _after(after_us: int | None, exact: bool) -> str:
    return "–" if after_us is None else after_text(after_us, exact)


def _detected(run: RunReport) -> str:
    return _after_spread((fault.detected_us, fault.exact) for fault in run.deaths)


def _taken_over(run: RunReport) -> str:
    return _after_spread((fault.taken_over_us, fault.exact) for fault in run.deaths)


def _after_spread(times: Iterable[tuple[int | None, bool]]) -> str:
    known = [(after_us, exact) for after_us, exact in times if after_us is not None]
    text = _spread(after_us / 1e3 for after_us, _ in known)
    return text if all(exact for _, exact in known) else f"about {text}"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f} %"


def _spread(values: Iterable[float | None]) -> str:
    """Return the median of milliseconds and, if there are several, the largest."""
    found = spread(values)
    if found is None:
        return "–"
    text = _ms(found["median"])
    return text if found["least"] == found["most"] else f"{text} (≤ {_ms(found['most'])})"


def _header(title: str, chips: str = "") -> str:
    return f'<header class="run"><h1>{escape(title)}</h1>{chips}</header>'


def _chip(words: str) -> str:
    kind = CHIPS.get(words, "")
    return f'<span class="chip {kind}">{SIGNS[kind]} {escape(words)}</span>'


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>" if body else ""


def _subsection(title: str, body: str) -> str:
    return f"<h3>{escape(title)}</h3>{body}" if body else ""


def _pair(first: str, second: str) -> str:
    """Place two parts side by side if there is room."""
    return f'<div class="pair">{first}{second}</div>' if first and second else first or second


def _table(
    head: Sequence[str], rows: Iterable[Sequence[str]], note: str = "", bars: Bars | None = None
) -> str:
    """Return a table of texts, with a note below it; empty if there is neither a row nor a note."""
    below = f'<p class="soft">{escape(note)}</p>' if note else ""
    lines = []
    for n, row in enumerate(rows):
        cells = ""
        for column, text in enumerate(row):
            kind = ' class="n"' if len(text) < 16 else ""
            if head[column] in SENTENCES:
                kind = f' class="{"longest" if len(text) > LONGEST else "long"}"'
            bar = (bars or {}).get((n, column))
            width = "" if bar is None else f'<i style="width:{100 * bar:.1f}%"></i>'
            meter = f'<span class="meter">{width}</span>' if width else ""
            cells += f"<td{kind}>{meter}{escape(text)}</td>"
        lines.append(f"<tr>{cells}</tr>")
    if not lines:
        return below
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    return _wide(f"<table><tr>{names}</tr>{''.join(lines)}</table>", head[-1]) + below


def _wide(body: str, name: str) -> str:
    """Make content scroll sideways, also by keyboard."""
    return f'<div class="wide" tabindex="0" role="group" aria-label="{escape(name)}">{body}</div>'
