"""The cost of a stranger's liveliness tokens to a team with keys, on real processes.

    python -m benchmarks.tokens [--seconds 15] [--tokens 1000 5000] [--names mixed] [--json FILE]

Three robots do short tasks for `--seconds`: first alone, then with a stranger who shows and drops
this many tokens again and again (`token_stranger`). It prints the tasks started per second, their
ratio to those of the team alone, the false deaths (all robots live to the end), and the processor
time that a robot used.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.missions import write_patrol
from benchmarks.report import run_program, say
from benchmarks.run import Run, cpu_s, stranger, team
from mrbt_mesh.drills.physical import read_events
from mrbt_mesh.runtime.run_dir import RunDir

ROBOTS = ("R1", "R2", "R3")


def write_mission(folder: Path) -> Path:
    """The mission of short tasks that never ends, and its program."""
    return write_patrol(folder, ROBOTS, "abc", 0.1, again=True)


def deaths(run_dir: Path) -> list[tuple[str, str]]:
    """(declaring robot, robot declared dead), from the robots' logs."""
    logs = {robot: read_events(run_dir / f"{robot}.log") for robot in RunDir(run_dir).robots()}
    return [
        (robot, line["robot"])
        for robot, lines in logs.items()
        for line in lines
        if line["event"] == "robot_dead"
    ]


def counted(seconds: float, tokens: int, names: str) -> dict[str, Any]:
    """One run of the team, with a stranger unless `tokens` is 0."""
    with team(write_mission) as run:
        run.wait_for_processes(len(ROBOTS))
        run.wait_for("explore", "start", robot=ROBOTS[-1])
        if not tokens:
            return _counted(run, seconds)
        with stranger("token_stranger", run.folder, str(tokens), names) as process:
            found = _counted(run, seconds)
            try:
                rounds, _ = process.communicate(timeout=5)
            except subprocess.TimeoutExpired:
                rounds = "0"
            return {**found, "tokens": tokens, "names": names, "rounds": int(rounds or 0)}


def _counted(run: Run, seconds: float) -> dict[str, Any]:
    processes = list(run.processes().values())
    before, used_s, begun_s = _starts(run), cpu_s(processes), time.monotonic()
    time.sleep(seconds)
    took_s = time.monotonic() - begun_s
    started, used_s = _starts(run) - before, cpu_s(processes) - used_s
    return {
        "starts": started,
        "starts_per_s": round(started / took_s, 1),
        "false_deaths": len(deaths(run.folder)),
        "robot_cpu_percent": round(100 * used_s / took_s / len(processes), 1),
    }


def _starts(run: Run) -> int:
    return sum(line["event"] == "start" for line in run.events())


def measure(
    seconds: float = 15.0, tokens: Sequence[int] = (1_000, 5_000), names: str = "mixed"
) -> dict[str, Any]:
    """The team alone, then beside a stranger with each number of tokens."""
    alone = counted(seconds, 0, "")
    say(f"alone: {alone}")
    found = []
    for count in tokens:
        beside = counted(seconds, count, names)
        beside["ratio"] = round(beside["starts_per_s"] / alone["starts_per_s"], 2)
        say(f"{count} tokens: {beside}")
        found.append(beside)
    return {"alone": alone, "beside_a_stranger": found}


if __name__ == "__main__":
    run_program(__doc__, measure)
