"""What a stranger's liveliness tokens cost a team with keys, on real processes.

    python -m benchmarks.tokens [--seconds 15] [--tokens 1000 5000] [--names mixed] [--json FILE]

Three robots do short tasks for `--seconds`: first alone, then with a stranger who shows and drops
this many tokens again and again (`token_stranger`). It prints the tasks started per second, their
ratio to those of the team alone, the false deaths (all robots live to the end), and the processor
time that a robot used.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.report import script_parser
from benchmarks.run import Run, machine, say, stranger, tell
from mrbt_mesh.drills.physical import read_events
from mrbt_mesh.runtime.run_dir import RunDir

ROBOTS = ("R1", "R2", "R3")
MISSION = """\
mission: rounds
program: robot.py
parameters: {lines: [a, b, c]}
local_tasks: {step: {parameters: [line]}}
robot_types: {R: {capabilities: {step: 1}}}
robots: {R1: R, R2: R, R3: R}
global_tasks: {turn: {parameters: [line], needs: {step($line): {min: 1, max: 1}}}}
tree:
  Parallel:
    success: all
    for_each: {line: $lines}
    do: {Repeat: {cycles: -1, do: turn($line)}}
"""
PROGRAM = """\
import anyio
from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)


@robot.local_task
async def step(task: TaskContext, line: str) -> None:
    await anyio.sleep(0.1)
"""


def write_mission(folder: Path) -> Path:
    """The mission of short tasks that never ends, and its program."""
    (folder / "robot.py").write_text(PROGRAM)
    mission = folder / "mission.yaml"
    mission.write_text(MISSION)
    return mission


def deaths(run_dir: Path) -> list[tuple[str, str]]:
    """(who declared it, who was declared dead), from the robots' logs."""
    logs = {robot: read_events(run_dir / f"{robot}.log") for robot in RunDir(run_dir).robots()}
    return [
        (robot, line["robot"])
        for robot, lines in logs.items()
        for line in lines
        if line["event"] == "robot_dead"
    ]


def measure(seconds: float, count: int, names: str) -> dict[str, Any]:
    """One run of the team, with a stranger unless `count` is 0."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as name:
        folder = Path(name)
        run = Run(folder, write_mission(folder))
        try:
            run.wait_for_processes(len(ROBOTS))
            run.wait_for("step", "start", robot=ROBOTS[-1])
            if not count:
                return _counted(run, seconds)
            with stranger("token_stranger", run.folder, str(count), names) as process:
                found = _counted(run, seconds)
                try:
                    told, _ = process.communicate(timeout=5)
                except subprocess.TimeoutExpired:
                    told = "0"
                return {**found, "tokens": count, "names": names, "rounds": int(told or 0)}
        finally:
            run.stop()


def _counted(run: Run, seconds: float) -> dict[str, Any]:
    processes = list(run.processes().values())
    used_s = sum(sum(p.cpu_times()[:2]) for p in processes)
    before, begun_s = _starts(run), time.monotonic()
    time.sleep(seconds)
    took_s = time.monotonic() - begun_s
    started = _starts(run) - before
    used_s = sum(sum(p.cpu_times()[:2]) for p in processes) - used_s
    return {
        "starts": started,
        "starts_per_s": round(started / took_s, 1),
        "false_deaths": len(deaths(run.folder)),
        "robot_cpu_percent": round(100 * used_s / took_s / len(processes), 1),
    }


def _starts(run: Run) -> int:
    return sum(line["event"] == "start" for line in run.events())


def main() -> None:
    """Run the benchmark."""
    parser = script_parser(__doc__)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--tokens", type=int, nargs="+", default=[1_000, 5_000])
    parser.add_argument("--names", default="mixed", help="live, lives, unknown or mixed")
    options = parser.parse_args()
    alone = measure(options.seconds, 0, "")
    say(f"alone: {alone}")
    found = []
    for count in options.tokens:
        beside = measure(options.seconds, count, options.names)
        beside["ratio"] = round(beside["starts_per_s"] / alone["starts_per_s"], 2)
        say(f"{count} tokens: {beside}")
        found.append(beside)
    tell({"machine": machine(), "alone": alone, "beside_a_stranger": found}, options.json)


if __name__ == "__main__":
    main()
