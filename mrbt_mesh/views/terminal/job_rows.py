"""Texts about jobs: a row for each, and the details of one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rich.text import Text

from mrbt_mesh.core.mission.jobs import utc_text
from mrbt_mesh.core.mission.mission import JobType
from mrbt_mesh.observer.job_rows import HELD, RUNNING, WAITING
from mrbt_mesh.observer.time_at_work import duration_text

# By the states of `JobRow`.
MARKS = {
    RUNNING: ("▶", "bold cyan"),
    WAITING: ("◷", "yellow"),
    HELD: ("‖", "yellow"),
    "succeeded": ("✔", "green"),
    "failed": ("✘", "red"),
    "cancelled": ("⊘", "dim"),
    "expired": ("⊘", "red"),
}
OPEN = (RUNNING, WAITING, HELD)
# The maximum number of jobs that are drawn.
MOST = 200


def in_order(jobs: Mapping[str, dict[str, Any]]) -> list[str]:
    """Return the jobs in the page's order.

    Running ones come first, then waiting ones, each by priority, then the newest that have ended.
    """

    def rank(job: str) -> tuple[Any, ...]:
        item = jobs[job]
        if item["state"] in OPEN:
            return 0, item["state"] != RUNNING, -item["priority"], job
        return 1, False, -(item["since_s"] or 0.0), job

    return sorted(jobs, key=rank)


def counts_text(jobs: Iterable[Mapping[str, Any]]) -> str:
    """Return `2 running, 1 waiting, 7 ended`."""
    counts = dict.fromkeys((*OPEN, "ended"), 0)
    for item in jobs:
        counts[item["state"] if item["state"] in OPEN else "ended"] += 1
    return ", ".join(f"{count} {state}" for state, count in counts.items() if count)


def job_text(job: str, item: dict[str, Any], unix_us: int | None) -> Text:
    """Return state, id, type, robots, priority, when it is due, and what it waits for.

    `item`: as in `TeamState`. `unix_us`: the time by the team's clocks; None: not known.
    """
    sign, style = MARKS[item["state"]]
    text = Text(no_wrap=True).append(f"{sign} {item['state']:<9} ", style)
    text.append(f"{job} ", "dim").append(_what(item), "bold")
    if item["robots"]:
        text.append(f" {' '.join(item['robots'])}", "cyan" if item["state"] in OPEN else "dim")
    if item["priority"]:
        text.append(f" priority {item['priority']}")
    if due := _due(item, unix_us):
        text.append_text(due)
    if why := _why(item, unix_us):
        text.append(f" {why}", "dim")
    return text


def job_details(job: str, item: dict[str, Any], unix_us: int | None) -> Text:
    """Return everything that is known of one job."""
    sign, style = MARKS[item["state"]]
    text = Text.assemble((f"{sign} {item['state']}", style), " ", (_what(item), "bold"), f"  {job}")
    if item["why"]:
        text.append(f"\n{item['why']}")
    if item["robots"]:
        verb = "works on it" if item["state"] == RUNNING else "worked on it"
        text.append(f"\n{', '.join(item['robots'])} {verb}")
    said = [f"priority {item['priority']}"] if item["priority"] is not None else []
    if item["deadline_us"]:
        said.append(f"deadline {utc_text(item['deadline_us'])}")
        if due := _due(item, unix_us):
            said[-1] += f" ({due.plain.strip()})"
    if item["operator"]:
        said.append(f"submitted by {item['operator']}")
    text.append("\n" + ", ".join(said), "dim")
    return text


def nothing_text(types: Mapping[str, JobType]) -> str:
    """Return how to submit the first job."""
    name, kind = next(iter(types.items()))
    return " ".join(["none yet: mrbt submit", name, *(each.name for each in kind.parameters)])


def _what(item: Mapping[str, Any]) -> str:
    values = ",".join(map(str, item["arguments"].values()))
    return f"{item['type']}({values})" if values else str(item["type"])


def _why(item: Mapping[str, Any], unix_us: int | None) -> str:
    """Return what it waits for, or for how long if it may not begin yet."""
    if item["state"] == WAITING and unix_us is not None:
        wait_s = ((item["not_before_us"] or 0) - unix_us) / 1e6
        if wait_s > 0:
            return f"begins in {duration_text(wait_s)}"
    return str(item["why"])


def _due(item: Mapping[str, Any], unix_us: int | None) -> Text | None:
    """Return `due in 3 min` for an open job."""
    if not item["deadline_us"] or item["state"] not in OPEN or unix_us is None:
        return None
    left_s = (item["deadline_us"] - unix_us) / 1e6
    if left_s < 0:
        return Text(f" due {duration_text(-left_s)} ago", "red")
    return Text(f" due in {duration_text(left_s)}", "yellow" if left_s < 60 else "dim")
