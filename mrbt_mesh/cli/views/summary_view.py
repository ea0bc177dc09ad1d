"""The end of a run for people: result, robots, global tasks, faults and what was blocked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from mrbt_mesh.core.facts.records import problem_text
from mrbt_mesh.core.facts.values import texts_by_reason
from mrbt_mesh.core.observer.episodes import lost_text

RESULTS = {
    "success": ("✔", "bold green", "mission succeeded"),
    "failure": ("✘", "bold red", "mission failed"),
    "timeout": ("⧗", "bold yellow", "mission not finished in time"),
    "blocked": ("■", "bold yellow", "mission blocked"),
    "not_started": ("…", "bold yellow", "mission not started: its team has not gathered"),
}
PLAIN = "not bold"
MOST_BIDS = 20
MOST_FAILURES = 20
STATES = {"alive": "green", "suspect": "yellow", "dead": "red", "left": "dim"}
STATUSES = {
    "success": "green",
    "failure": "red",
    "running": "yellow",
    "idle": "dim",
    "cancelled": "dim",
}


def render_summary(summary: Mapping[str, Any]) -> RenderableType:
    """A rich renderable of the summary that `mrbt up --json` prints."""
    parts: list[RenderableType] = [_headline(summary), Text(), _robots(summary), Text()]
    if summary.get("rounds"):
        parts += [_rounds(summary["rounds"]), Text()]
    parts.append(_global_tasks(summary))
    if summary.get("bids"):
        parts += [Text(), _bids(summary["bids"])]
    story = _story(summary)
    if story:
        table = _table("at", "what happened")
        table.columns[0].justify = "right"
        for at_s, line in story:
            table.add_row(_seconds(at_s), line)
        parts += [Text(), table]
    return Group(*parts)


def _headline(summary: Mapping[str, Any]) -> Text:
    result = str(summary.get("result"))
    mark, style, words = RESULTS.get(result, ("?", "bold", result))
    if summary.get("ends") == "never" and result in ("success", "failure"):
        words = _standing_by(summary["rounds"])
    line = Text.assemble((f"{mark} {words}", style))
    if summary.get("mission"):
        line.append(f"  {summary['mission']}", "bold")
    line.append(f"  {_seconds(summary.get('duration_s'))}")
    robots = summary.get("robots", {})
    line.append(f"  {_count(len(robots), 'robot')}", "dim")
    faults = len(summary.get("faults", ()))
    line.append(f", {_count(faults, 'fault')}" if faults else ", no faults", "dim")
    return line


def _standing_by(rounds: Sequence[Mapping[str, Any]]) -> str:
    ended = [each["result"] for each in rounds if each["result"] is not None]
    if not ended:
        return "stood by: there was nothing to do"
    words = "succeeded" if ended[-1] == "success" else "failed"
    on_its_way = "; one is on its way" if len(ended) < len(rounds) else ""
    return f"stood by: {_count(len(ended), 'round')}, the last one {words}{on_its_way}"


def _robots(summary: Mapping[str, Any]) -> Table:
    table = _table("robot", "type", "state", "lost or changed", "took part in")
    for robot, known in summary.get("robots", {}).items():
        state = known.get("state") or "?"
        tasks = [
            name
            for name, task in summary.get("global_tasks", {}).items()
            if robot in task.get("robots", ())
        ]
        table.add_row(
            Text(robot, "bold"),
            Text(known.get("type") or ""),
            Text(state, STATES.get(state, "")),
            capability_changes(known),
            Text(", ".join(tasks)),
        )
    return table


def capability_changes(known: Mapping[str, Any]) -> Text:
    """What a robot has lost or cannot use yet, and why; what it does better or worse than the
    mission says.
    """
    lost, lines = known.get("lost", {}), []
    for reason, names in texts_by_reason(lost).items():
        lines.append(Text(lost_text(names, reason), "red"))
    for reason, names in texts_by_reason(known.get("pending", {})).items():
        lines.append(Text(f"{', '.join(names)} not yet: {reason}", "yellow"))
    performances = known.get("performances", {}).items()
    changed = [f"{name} {value:g}" for name, value in performances if name not in lost]
    if changed:
        lines.append(Text(", ".join(changed), "yellow"))
    return Text("\n").join(lines)


def _rounds(rounds: Sequence[Mapping[str, Any]]) -> Table:
    """When each round began, how long it took, how it ended, and who ran something."""
    table = _table("round", "from", "took", "result", "robots")
    for column in table.columns[:3]:
        column.justify = "right"
    for number, each in enumerate(rounds, start=1):
        result = each["result"] or "running"
        table.add_row(
            str(number),
            _seconds(each["from_s"]),
            _seconds(each["duration_s"]),
            Text(result, STATUSES[result]),
            Text(", ".join(each["robots"])),
        )
    return table


def _global_tasks(summary: Mapping[str, Any]) -> RenderableType:
    """Global tasks that came up, and the number of those that did not."""
    table = _table("global task", "status", "robots")
    idle = 0
    for name, task in summary.get("global_tasks", {}).items():
        status = str(task.get("status"))
        if status == "idle" and not task.get("robots"):
            idle += 1
            continue
        table.add_row(
            Text(name), Text(status, STATUSES.get(status, "")), Text(", ".join(task["robots"]))
        )
    if not idle:
        return table
    return Group(table, Text(f" and {_count(idle, 'global task')} that never came up", "dim"))


def _bids(biddings: Sequence[Mapping[str, Any]]) -> RenderableType:
    """Who bid what, the best first, and in bold who did it."""
    table = _table("local task", "bids")
    for bidding in biddings[:MOST_BIDS]:
        bids, line = bidding["bids"], Text()
        made = {robot: bid for robot, bid in bids.items() if bid is not None}
        for robot in [
            *sorted(made, key=lambda r: (-made[r], r)),
            *sorted(bids.keys() - made.keys()),
        ]:
            text = f"{robot} {made[robot]:g}" if robot in made else f"{robot} none"
            line.append(", " if line else "", PLAIN)
            line.append(text, "bold" if robot in bidding["robots"] else "dim")
        table.add_row(Text(bidding["local_task"]), line)
    more = len(biddings) - MOST_BIDS
    if more <= 0:
        return table
    return Group(table, Text(f" and bids for {_count(more, 'other')}", "dim"))


def _story(summary: Mapping[str, Any]) -> list[tuple[float, Text]]:
    """Faults, failures and blocked episodes as (seconds, text), in the order of time."""
    takeovers = {(t["robot"], t.get("at_s")): t for t in summary.get("takeovers", ())}
    story = []
    for fault in summary.get("faults", ()):
        line, until_s = Text(fault["robot"], "bold"), fault.get("until_s")
        if fault.get("kind") == "minor":
            what = lost_text(fault["local_tasks"], fault["reason"])
            line.append(f" {what}", "not bold yellow")
            end = "had it again"
        else:
            line.append(" died", "not bold red")
            _takeover(line, takeovers.get((fault["robot"], fault.get("at_s"))))
            end = "was back"
        if until_s is not None:
            line.append(f"; {end} at {_seconds(until_s)}", "not bold green")
        story.append((fault.get("at_s") or 0.0, line))
    failures = summary.get("failures", ())
    for end in failures[:MOST_FAILURES]:
        story.append((end.get("at_s") or 0.0, failure_line(end)))
    if len(failures) > MOST_FAILURES:
        left = _count(len(failures) - MOST_FAILURES, "other failure")
        story.append((failures[MOST_FAILURES].get("at_s") or 0.0, Text(f"and {left}", "dim")))
    for each in summary.get("problems", ()):
        story.append((each.get("at_s") or 0.0, problem_line(each)))
    for episode in summary.get("blocked", ()):
        line = Text(episode["request"], "bold")
        line.append(f" {episode['reason']}", "not bold yellow")
        to_s = episode.get("to")
        line.append(", to the end" if to_s is None else f", until {_seconds(to_s)}", PLAIN)
        story.append((episode.get("from") or 0.0, line))
    return sorted(story, key=lambda item: item[0])


def problem_line(problem: Mapping[str, Any]) -> Text:
    """What is or was wrong with a robot's program or journal."""
    line = Text(problem["robot"], "bold")
    line.append(f": {problem_text(problem['subject'], problem['problem'])}", "not bold red")
    until_s = problem.get("until_s")
    return line.append("" if until_s is None else f"; until {_seconds(until_s)}", "not bold green")


def failure_line(end: Mapping[str, Any]) -> Text:
    """Who failed at what, and why, as far as its program said it."""
    line = Text(end["robot"], "bold")
    whole = "" if end["local_task"] == end["global_task"] else f" for {end['global_task']}"
    line.append(f" failed at {end['local_task']}{whole}", "not bold red")
    line.append(f": {end['reason']}" if end["reason"] else "", PLAIN)
    return line


def _takeover(line: Text, takeover: Mapping[str, Any] | None) -> None:
    if takeover is None:
        return
    if takeover.get("detected_s") is not None:
        line.append(f", noticed after {_milliseconds(takeover['detected_s'])}", PLAIN)
    if takeover.get("held"):
        line.append(f", while on {takeover['held']}", PLAIN)
    if takeover.get("replacement"):
        after = _milliseconds(takeover.get("reassigned_s"))
        line.append(f", replaced by {takeover['replacement']} after {after}", PLAIN)


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=True, header_style="dim")
    for index, heading in enumerate(headings):
        table.add_column(heading, no_wrap=index == 0, overflow="fold")
    return table


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _seconds(value: float | None) -> str:
    return "?" if value is None else f"{value:.2f} s"


def _milliseconds(value: float | None) -> str:
    return "?" if value is None else f"{value * 1_000:.0f} ms"
