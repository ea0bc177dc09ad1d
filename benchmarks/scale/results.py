"""Tables and plots of what was found."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from benchmarks.registry import Chart
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
    """The table of real processes, for docs/explanation/scale.md."""
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
    """The tables of simulated teams, for docs/explanation/scale.md."""
    kinds = ("outcome", "new plan", "kill", "freeze")
    costs = [
        [
            size.robots,
            f"{size.rest_messages:.1f}",
            f"{size.rest_bytes / 1_000:.1f}",
            *(_most(size.events.get(kind)) for kind in kinds),
            size.launch_most,
        ]
        for size in sizes
    ]
    times = [
        [
            size.robots,
            seconds(size.launch_s),
            f"{Timing().of_team(size.robots).detection_us / SECOND_US:g}",
            *(
                spread(size.events[kind].replaced_s if kind in size.events else ())
                for kind in kinds[1:]
            ),
        ]
        for size in sizes
    ]
    rest = [
        [
            size.robots,
            size.facts,
            seconds(size.facts_s),
            seconds(size.late_s),
            f"{size.late_kb:.0f}",
            seconds(size.cut_s, 1),
            seconds(size.healed_s),
            f"{size.cpu_s:.0f}",
        ]
        for size in sizes
        if size.facts
    ]
    return "\n\n".join(
        [
            "**Messages.** Sent per robot and second at rest, and kB; then received of one event "
            "beyond that: by the robot that received most / by a robot on average. Launch: all "
            "that the robot received that received most.",
            grid(["robots", "at rest", "kB", *kinds, "launch"], costs),
            "**Seconds.** From the launch until all areas are worked on; the detection time; from "
            "an event until another robot has started, with the team's agreement (median / "
            "longest).",
            grid(["robots", "launch", "detection time", *kinds[1:]], times),
            "**Facts, late robots, partitions.** So many facts, most of them new at once, until "
            "all robots hold them; a robot that starts late, with an empty journal, until it has "
            "them and is in the plan, and what all send for it, kB; two halves that are cut off, "
            "until each has buried the other, and from the healing until they are one team again. "
            "Seconds; `cpu`: of the simulation.",
            grid(
                ["robots", "facts", "known", "late", "kB", "cut off", "healed", "cpu"],
                rest,
            ),
        ]
    )


def charts(sizes: Sequence[Size]) -> list[Chart]:
    """What is worth a picture."""

    def events(kind: str, of: str) -> list[tuple[float, float]]:
        found = [(size.robots, size.events.get(kind)) for size in sizes]
        return [(n, max(1.0, max(getattr(each, of)))) for n, each in found if each is not None]

    kinds = ("outcome", "new plan", "kill", "freeze")
    return [
        Chart(
            "rest",
            "What a robot sends at rest",
            "robots",
            "per second",
            {
                "messages": [(size.robots, size.rest_messages) for size in sizes],
                "kB": [(size.robots, size.rest_bytes / 1_000) for size in sizes],
            },
        ),
        Chart(
            "event",
            "Received of one event, by the robot that receives most",
            "robots",
            "messages beyond those at rest",
            {kind: events(kind, "most") for kind in kinds},
        ),
        Chart(
            "replacement",
            "Until another robot has started",
            "robots",
            "s",
            {
                kind: [
                    (size.robots, statistics.median(size.events[kind].replaced_s))
                    for size in sizes
                    if kind in size.events
                ]
                for kind in kinds[1:]
            },
        ),
    ]
