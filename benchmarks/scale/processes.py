"""Teams of real processes on one machine: their cost and their speed.

A patrol of N robots over N/2 areas that never ends, so that half of the team is at work and half
is free. For each size a team is started, left alone, and loses some robots one after the other:

launch    from the start of `mrbt up` until there is a robot at work in every area
at rest   processor time of all robots together, memory of one, over some seconds
kill      SIGKILL of a robot at work until another one has started in its area

Memory: resident, and the robot's share of it (pages that several processes have count by parts).
"""

from __future__ import annotations

import os
import signal
import statistics
import time
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from benchmarks.missions import write_patrol
from benchmarks.report import say
from benchmarks.run import Run, cpu_s, team, until

LAUNCH_TIMEOUT_S, KILL_TIMEOUT_S = 240.0, 60.0
# How long the team settles after the launch, and how long is measured then.
SETTLE_S, REST_S = 10.0, 10.0


@dataclass
class Size:
    """Figures of one team; None: not in time."""

    robots: int
    launch_s: float | None = None
    cpu_at_rest_percent: float | None = None
    rss_mb: float | None = None
    share_mb: float | None = None
    kills_ms: list[float | None] = field(default_factory=list)


def write_mission(folder: Path, robots: int) -> Path:
    """The mission of a team of this many robots."""
    names = [f"R{robot:03}" for robot in range(robots)]
    return write_patrol(folder, names, [f"a{area:03}" for area in range(robots // 2)])


def workers(run: Run) -> dict[str, str]:
    """Area -> the robot at work there; during the launch some begin and are cancelled."""
    areas: dict[str, str] = {}
    for line in run.events():
        if line["event"] == "start":
            areas[line["robot"]] = line["args"][0]
        else:
            areas.pop(line["robot"], None)
    return {area: robot for robot, area in areas.items()}


def rest(run: Run, found: Size) -> None:
    """Processor time and memory of the team, left alone."""
    processes = list(run.processes().values())
    time.sleep(SETTLE_S)
    found.cpu_at_rest_percent = percent_of_a_core(processes, REST_S)
    memory = [process.memory_full_info() for process in processes]
    found.rss_mb = round(statistics.median(each.rss for each in memory) / 1e6, 1)
    if hasattr(memory[0], "pss"):
        found.share_mb = round(statistics.median(each.pss for each in memory) / 1e6, 1)


def percent_of_a_core(processes: list[psutil.Process], seconds: float) -> float:
    """Processor time that processes use together while they are watched."""
    before_s, began_s = cpu_s(processes), time.monotonic()
    time.sleep(seconds)
    spent_s = cpu_s(processes) - before_s
    return round(100 * spent_s / (time.monotonic() - began_s), 1)


def kill_ms(run: Run, area: str) -> float | None:
    """Kill the robot at work in an area; milliseconds until another one has started there."""
    victim = workers(run)[area]
    killed_s = time.time()
    os.kill(run.processes()[victim].pid, signal.SIGKILL)

    def replaced_ms() -> float | None:
        for line in run.events():
            if line["event"] == "start" and line["t"] > killed_s and line["args"] == [area]:
                return round(1e3 * (float(line["t"]) - killed_s), 1)
        return None

    return until(replaced_ms, KILL_TIMEOUT_S)


def measure(robots: int, kills: int, *options: str) -> Size:
    """Start one team and measure it."""
    found, started_s = Size(robots), time.monotonic()
    with team(lambda folder: write_mission(folder, robots), *options) as run:

        def at_work_s() -> float | None:
            if run.process.poll() is not None:
                raise RuntimeError("the team has ended")
            passed_s = time.monotonic() - started_s
            return passed_s if len(workers(run)) == robots // 2 else None

        found.launch_s = until(at_work_s, LAUNCH_TIMEOUT_S)
        say(f"{robots} robots: at work after {found.launch_s} s")
        if found.launch_s is None:
            return found
        rest(run, found)
        for area in sorted(workers(run))[:kills]:
            found.kills_ms.append(kill_ms(run, area))
            say(f"{robots} robots: killed, replaced after {found.kills_ms[-1]} ms")
    return found
