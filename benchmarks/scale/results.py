"""Tables and a picture of the figures."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import grid
from benchmarks.scale import processes
from benchmarks.scale.simulated import GIVE_UP_US, Event, Size
from mrbt_mesh.core.membership.timing import SECOND_US, Timing

LATE = "not in time"


def seconds(found_s: float | None, digits: int = 2) -> str:
    """How long something took, for people."""
    return LATE if found_s is None else f"{found_s:.{digits}f}"


def spread(times_s: Sequence[float]) -> str:
    """Median and longest of some times."""
    late_s = GIVE_UP_US / SECOND_US
    if not times_s:
        return ""
    ends = (statistics.median(times_s), max(times_s))
    return " / ".join(LATE if each >= late_s else f"{each:.2f}" for each in ends)


def of_processes(teams: Sequence[processes.Size]) -> str:
    """The table of real processes, for docs/data/scale.md."""
    head = ("robots", "launch, s", "all at rest, % of a core", "resident, MB", "share, MB")
    rows = []
    for team in teams:
        kills = [ms for ms in team.kills_ms if ms is not None]
        longest = f"{max(kills):.0f}" if kills else ""
        worst = LATE if None in team.kills_ms else longest
        median = f"{statistics.median(kills):.0f}" if kills else ""
        costs = (team.cpu_at_rest_percent, team.rss_mb, team.share_mb)
        shown = ["" if cost is None else f"{cost:.1f}" for cost in costs]
        rows.append([team.robots, seconds(team.launch_s, 1), *shown, median, worst])
    return grid([*head, "kill, median ms", "worst ms"], rows)


def _most(event: Event | None) -> str:
    if event is None:
        return ""
    return f"{max(event.most):.0f} / {statistics.mean(event.mean):.0f}"


def of_simulated(sizes: Sequence[Size]) -> str:
    """The tables of simulated teams, for docs/data/scale.md."""
    kinds = ("outcome", "new plan", "kill", "freeze")
    costs, times, rest = [], [], []
    for size in sizes:
        sent = f"{size.rest_messages:.1f}", f"{size.rest_bytes / 1_000:.1f}"
        received = (_most(size.events.get(kind)) for kind in kinds)
        costs.append([size.robots, *sent, *received, size.launch_most])
        detection_s = Timing().of_team(size.robots).detection_us / SECOND_US
        replaced = (
            spread(size.events[kind].replaced_s if kind in size.events else ())
            for kind in kinds[1:]
        )
        times.append([size.robots, seconds(size.launch_s), f"{detection_s:g}", *replaced])
        if size.facts:
            late = seconds(size.facts_s), seconds(size.late_s), f"{size.late_kb:.0f}"
            cut = seconds(size.cut_s, 1), seconds(size.healed_s), f"{size.cpu_s:.0f}"
            rest.append([size.robots, size.facts, *late, *cut])
    return "\n\n".join(
        [
            "**Messages.** Sent per robot and second at rest, and kB; then received of one event "
            "beyond that: by the robot that received most / by a robot on average. Launch: all "
            "messages to the robot that received most.",
            grid(["robots", "at rest", "kB", *kinds, "launch"], costs),
            "**Seconds.** From the launch until all areas are worked on; the detection time; from "
            "an event until another robot has started, with the team's agreement (median / "
            "longest).",
            grid(["robots", "launch", "detection time", *kinds[1:]], times),
            "**Facts, late robots, partitions.** `known`: until all robots hold this number of "
            "facts, most of them new at once. `late`: until a robot that starts with an empty "
            "journal has them and is in the plan; `kB`: what all send for it. `cut off`: until "
            "each half of a divided team has declared the other dead; `healed`: from the healing "
            "until they are one team again. All in seconds; `cpu`: of the simulation.",
            grid(["robots", "facts", "known", "late", "kB", "cut off", "healed", "cpu"], rest),
        ]
    )


def draw(rows: Sequence[Mapping[str, Any]], file: Path) -> None:
    """Draw what a robot sends at rest, by the size of its team; `rows` as in the JSON."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    robots = [row["robots"] for row in rows]
    for label, name, unit in (("messages", "rest_messages", 1), ("kB", "rest_bytes", 1_000)):
        sent = [row[name] / unit for row in rows]
        axes.plot(robots, sent, marker="o", markersize=4, linewidth=1.2, label=label)
    axes.set(xscale="log", yscale="log", xlabel="robots", ylabel="per second")
    axes.set_title("What a robot sends at rest", fontsize="medium")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    figure.savefig(file, dpi=150)
