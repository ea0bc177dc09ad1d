"""The end of a run for people: result, robots, global tasks, faults, blocked requests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mrbt_mesh.cli.printing import Printable, Stack, Styled
from mrbt_mesh.cli.terminal import table
from mrbt_mesh.cli.views.marks import STATE_MARKS
from mrbt_mesh.core.facts.records import problem_text
from mrbt_mesh.core.facts.values import texts_by_reason
from mrbt_mesh.observer.episodes import after_text, lost_text
from mrbt_mesh.observer.summary import ABORTED
from mrbt_mesh.observer.time_at_work import duration_text

RESULTS = {
    "success": ("✔", "bold green", "mission succeeded"),
    "failure": ("✘", "bold red", "mission failed"),
    "timeout": ("⧗", "bold yellow", "mission not finished in time"),
    "blocked": ("■", "bold yellow", "mission blocked"),
    "ended": ("■", "bold", "mission not finished: an operator has ended it"),
    "not_started": ("…", "bold yellow", "mission not started: its team has not gathered"),
}
MOST_BIDS = 20
JOB_STATES = "succeeded", "failed", "expired", "cancelled", "open"
MOST_FAILURES = 20
STATUSES = {"success": "green", "failure": "red", "running": "yellow"}


def render_summary(summary: Mapping[str, Any]) -> Printable:
    """Return the summary that `mrbt up --json` prints, for a terminal."""
    tasks = summary.get("global_tasks", {})
    robots = table("robot", "type", "state", "faults", "tasks")
    for robot, known in summary.get("robots", {}).items():
        state = known.get("state") or "?"
        robots.add_row(
            Styled(robot, "bold"),
            known.get("type") or "",
            Styled(state, STATE_MARKS.get(state, ("", ""))[1]),
            capability_changes(known),
            Styled(", ".join(name for name, task in tasks.items() if robot in task["robots"])),
        )
    parts: list[Printable] = [_headline(summary), Styled(), robots, Styled()]
    older = summary.get("older", {})
    if summary.get("rounds"):
        rounds = table("round", "from", "took", "result", "robots", right=range(3))
        for number, each in enumerate(summary["rounds"], start=1 + older.get("rounds", 0)):
            result = each["result"] or "running"
            times = _seconds(each["from_s"]), _seconds(each["duration_s"])
            robots_then = Styled(", ".join(each["robots"]))
            rounds.add_row(str(number), *times, Styled(result, STATUSES[result]), robots_then)
        parts += [rounds, Styled()]
    listed, idle = table("global task", "status", "robots"), 0
    for name, task in tasks.items():
        status = str(task.get("status"))
        if status == "idle" and not task["robots"]:
            idle += 1
            continue
        status_text = Styled(status, STATUSES.get(status, "dim"))
        listed.add_row(Styled(name), status_text, Styled(", ".join(task["robots"])))
    if listed.row_count or not summary.get("jobs"):
        parts.append(listed)
    if idle:
        parts.append(Styled(f"and {_count(idle, 'global task')} that never became due", "dim"))
    if summary.get("jobs"):
        parts += [*([Styled()] if listed.row_count or idle else []), _jobs(summary["jobs"])]
    if summary.get("bids"):
        parts += [Styled(), _bids(summary["bids"], older.get("bids", 0))]
    story = sorted(_story(summary), key=lambda item: item[0] or 0.0)
    if story:
        events = table("at", "what happened", right=(0,))
        for at_s, line in story:
            events.add_row(_seconds(at_s), line)
        parts += [Styled(), events]
    return Stack(*parts)


def _headline(summary: Mapping[str, Any]) -> Styled:
    result = str(summary.get("result"))
    mark, style, words = RESULTS.get(result, ("?", "bold", result))
    if summary.get("ended_because") == ABORTED:
        mark, style, words = "■", "bold yellow", "mission aborted"
    elif summary.get("ends") == "never" and result in ("success", "failure"):
        words = _standing_by(summary["rounds"], summary.get("older", {}).get("rounds", 0))
    faults = len(summary.get("faults", ()))
    still_open = sum(each["open"] for each in summary.get("jobs", {}).values())
    return Styled.assemble(
        (f"{mark} {words}", style),
        (f"  {summary['mission']}" if summary.get("mission") else "", "bold"),
        f"  {_seconds(summary.get('duration_s'))}",
        (f"  {_count(len(summary.get('robots', ())), 'robot')}", "dim"),
        (f", {_count(faults, 'fault')}" if faults else ", no faults", "dim"),
        (f", {_count(still_open, 'job')} open" if still_open else "", "bold"),
        (f"\n  {because}" if (because := summary.get("ended_because")) else "", "bold"),
    )


def _standing_by(rounds: Sequence[Mapping[str, Any]], older: int) -> str:
    ended = [each["result"] for each in rounds if each["result"] is not None]
    if not ended:
        return "stood by: there was nothing to do"
    words = "succeeded" if ended[-1] == "success" else "failed"
    on_its_way = "; one is on its way" if len(ended) < len(rounds) else ""
    return f"stood by: {_count(older + len(ended), 'round')}, the last one {words}{on_its_way}"


def capability_changes(known: Mapping[str, Any]) -> Styled:
    """Return a robot's lost and pending capabilities with reasons, and changed performances."""
    lost = known.get("lost", {})
    lines = [
        Styled(lost_text(names, reason), "red") for reason, names in texts_by_reason(lost).items()
    ]
    for reason, names in texts_by_reason(known.get("pending", {})).items():
        lines.append(Styled(f"cannot use {', '.join(names)} now: {reason}", "yellow"))
    performances = known.get("performances", {}).items()
    changed = [f"{name} {value:g}" for name, value in performances if name not in lost]
    if changed:
        lines.append(Styled(", ".join(changed), "yellow"))
    return Styled("\n").join(lines)


def _jobs(jobs: Mapping[str, Mapping[str, Any]]) -> Printable:
    """Return the results of the jobs of each type."""
    rows = table("jobs", "ends", "waited", "worked", "robots")
    for kind, each in jobs.items():
        ends = [f"{each[state]} {state}" for state in JOB_STATES if each[state]]
        if each["late"]:
            ends.append(f"{each['late']} of them late by {_mean(each['late_s'])}")
        robots = ", ".join(f"{robot} {count}" for robot, count in each["robots"].items())
        times = [Styled(_mean(each[key]), no_wrap=True) for key in ("waited_s", "worked_s")]
        rows.add_row(Styled(kind), ", ".join(ends), *times, Styled(robots))
    return rows


def _mean(times: Mapping[str, float | None]) -> str:
    """Return the mean of a time, and its maximum if that differs; empty if nothing is known."""
    if times["mean"] is None:
        return ""
    mean, most = duration_text(times["mean"]), duration_text(times["most"] or 0)
    return mean if mean == most else f"{mean} (most {most})"


def _bids(biddings: Sequence[Mapping[str, Any]], older: int) -> Printable:
    """Return the bids, the best first, with those of the robots that did the task in bold."""
    rows = table("local task", "bids")
    for bidding in biddings[:MOST_BIDS]:
        bids = bidding["bids"]
        order = sorted(bids, key=lambda r: (bids[r] is None, -(bids[r] or 0), r))
        texts = [
            Styled(
                f"{robot} none" if bids[robot] is None else f"{robot} {bids[robot]:g}",
                "bold" if robot in bidding["robots"] else "dim",
            )
            for robot in order
        ]
        rows.add_row(Styled(bidding["local_task"]), Styled(", ").join(texts))
    more = max(0, len(biddings) - MOST_BIDS) + older
    if more <= 0:
        return rows
    return Stack(rows, Styled(f"and bids for {_count(more, 'other')}", "dim"))


def _story(summary: Mapping[str, Any]) -> Iterator[tuple[float | None, Styled]]:
    """Yield (seconds, text) of faults, failures, problems and blocked episodes."""
    takeovers = {(t["robot"], t.get("at_s")): t for t in summary.get("takeovers", ())}
    for fault in summary.get("faults", ()):
        robot, at_s = (fault["robot"], "bold"), fault.get("at_s")
        if fault.get("kind") == "minor":
            lost = lost_text(fault["local_tasks"], fault["reason"])
            line, end = Styled.assemble(robot, (f" {lost}", "yellow")), "had it again"
        else:
            takeover = _takeover(takeovers.get((fault["robot"], at_s), {}))
            line, end = Styled.assemble(robot, (" died", "red"), takeover), "was back"
        if fault.get("until_s") is not None:
            line.append(f"; {end} at {_seconds(fault['until_s'])}", "green")
        yield at_s, line
    failures = summary.get("failures", ())
    for failure in failures[:MOST_FAILURES]:
        yield failure.get("at_s") or 0.0, failure_line(failure)
    more = max(0, len(failures) - MOST_FAILURES) + summary.get("older", {}).get("failures", 0)
    if more:
        at_s = failures[:MOST_FAILURES][-1].get("at_s") or 0.0
        yield at_s, Styled(f"and {_count(more, 'other failure')}", "dim")
    for each in summary.get("problems", ()):
        yield each.get("at_s") or 0.0, problem_line(each)
    for episode in summary.get("blocked", ()):
        to_s = episode.get("to")
        until = ", to the end" if to_s is None else f", until {_seconds(to_s)}"
        reason = (f" {episode['reason']}", "yellow")
        yield (
            episode.get("from") or 0.0,
            Styled.assemble((episode["request"], "bold"), reason, until),
        )


def problem_line(problem: Mapping[str, Any]) -> Styled:
    """Return a problem of a robot's program or journal, and its end if it has one."""
    until_s = problem.get("until_s")
    return Styled.assemble(
        (problem["robot"], "bold"),
        (f": {problem_text(problem['subject'], problem['problem'])}", "red"),
        ("" if until_s is None else f"; until {_seconds(until_s)}", "green"),
    )


def failure_line(end: Mapping[str, Any]) -> Styled:
    """Return the robot and the task that failed, with the reason if the program gave one."""
    whole = "" if end["local_task"] == end["global_task"] else f" for {end['global_task']}"
    return Styled.assemble(
        (end["robot"], "bold"),
        (f" failed at {end['local_task']}{whole}", "red"),
        f": {end['reason']}" if end["reason"] else "",
    )


def _takeover(takeover: Mapping[str, Any]) -> str:
    text = ""
    if takeover.get("detected_s") is not None:
        text += f", detected after {takeover_after(takeover, 'detected_s')}"
    if takeover.get("held"):
        text += f", while on {takeover['held']}"
    if takeover.get("replacement"):
        after = takeover_after(takeover, "reassigned_s")
        text += f", replaced by {takeover['replacement']} after {after}"
    return text


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _seconds(value: float | None) -> str:
    return "?" if value is None else f"{value:.2f} s"


def takeover_after(takeover: Mapping[str, Any], key: str) -> str:
    """Return a time of a takeover in a summary, as text."""
    value = takeover.get(key)
    return "?" if value is None else after_text(round(value * 1e6), takeover.get("exact", False))
