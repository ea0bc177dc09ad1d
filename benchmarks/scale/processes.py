"""Teams of real processes on one machine: what they cost, and how fast they are.

A patrol of N robots over N/2 areas that never ends, so that half of the team is at work and half
is free. For each size a team is started, left alone, and loses some robots one after the other:

launch    from the start of `mrbt up` until all areas are worked on, which the team has agreed on
at rest   processor time of all robots together, memory of one, over some seconds
kill      SIGKILL of a robot at work until another one has started in its area

Memory: resident, and the robot's share of it (pages that several processes have count by parts).
"""

from __future__ import annotations

import os
import signal
import statistics
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from benchmarks.run import ROOT, Run, say

SIZES = (6, 12, 24, 48, 64)
LAUNCH_TIMEOUT_S, KILL_TIMEOUT_S = 240.0, 60.0
# How long the team settles after the launch, and how long is measured then.
SETTLE_S, REST_S = 10.0, 10.0
LOOK_S = 0.005

PATROL = """\
mission: patrol
program: {program}
parameters: {{areas: [{areas}]}}
local_tasks: {{explore: {{parameters: [area], work: 1000000}}}}
robot_types: {{R: {{capabilities: {{explore: 1}}}}}}
robots: {{{robots}}}
global_tasks:
  visit: {{parameters: [area], needs: {{explore($area): {{min: 1, max: 1}}}}}}
tree:
  Parallel: {{success: all, for_each: {{area: $areas}}, do: visit($area)}}
"""


@dataclass
class Size:
    """Figures of one team; None: not in time."""

    robots: int
    launch_s: float | None = None
    cpu_at_rest_percent: float | None = None
    rss_mb: float | None = None
    share_mb: float | None = None
    kills_ms: list[float | None] = field(default_factory=list)


def patrol(robots: int) -> str:
    """The mission file of a team of this many robots."""
    return PATROL.format(
        program=ROOT / "agents" / "explore.py",
        areas=", ".join(f"a{area:03}" for area in range(robots // 2)),
        robots=", ".join(f"R{robot:03}: R" for robot in range(robots)),
    )


def workers(run: Run) -> dict[str, str]:
    """Area -> the robot that started there last."""
    return {line["args"][0]: line["robot"] for line in run.events() if line["event"] == "start"}


def launch_s(run: Run, areas: int, started_s: float) -> float | None:
    """Seconds until robots have started in all areas."""
    while time.monotonic() < started_s + LAUNCH_TIMEOUT_S and run.process.poll() is None:
        if len(workers(run)) == areas:
            return time.monotonic() - started_s
        time.sleep(LOOK_S)
    return None


def rest(run: Run, found: Size) -> None:
    """Processor time and memory of the team, left alone."""
    processes = list(run.processes().values())
    time.sleep(SETTLE_S)
    before_s, begun_s = _cpu_s(processes), time.monotonic()
    time.sleep(REST_S)
    spent_s, over_s = _cpu_s(processes) - before_s, time.monotonic() - begun_s
    memory = [process.memory_full_info() for process in processes]
    found.cpu_at_rest_percent = round(100 * spent_s / over_s, 1)
    found.rss_mb = round(statistics.median(each.rss for each in memory) / 1e6, 1)
    if hasattr(memory[0], "pss"):
        found.share_mb = round(statistics.median(each.pss for each in memory) / 1e6, 1)


def _cpu_s(processes: list[psutil.Process]) -> float:
    return sum(sum(process.cpu_times()[:2]) for process in processes)


def kill_ms(run: Run, area: str) -> float | None:
    """Kill the robot at work in an area; milliseconds until another one has started there."""
    victim = workers(run)[area]
    killed_s = time.time()
    os.kill(run.processes()[victim].pid, signal.SIGKILL)
    while time.time() < killed_s + KILL_TIMEOUT_S:
        for line in run.events():
            if line["event"] == "start" and line["t"] > killed_s and line["args"] == [area]:
                return round(1e3 * (float(line["t"]) - killed_s), 1)
        time.sleep(LOOK_S)
    return None


def measure(robots: int, kills: int, *options: str) -> Size:
    """Start one team and measure it."""
    found = Size(robots)
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        mission = Path(folder) / "mission.yaml"
        mission.write_text(patrol(robots))
        started_s = time.monotonic()
        run = Run(Path(folder), mission, *options)
        try:
            found.launch_s = launch_s(run, robots // 2, started_s)
            say(f"{robots} robots: at work after {found.launch_s} s")
            if found.launch_s is None:
                return found
            rest(run, found)
            for area in sorted(workers(run))[:kills]:
                found.kills_ms.append(kill_ms(run, area))
                say(f"{robots} robots: killed, replaced after {found.kills_ms[-1]} ms")
        finally:
            run.stop()
    return found
