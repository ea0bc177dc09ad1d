"""Jobs that are handed to a real team while its robots are killed and start again.

    python -m benchmarks.submissions [--count 1000] [--rate 20] [--kill_every 5] [--kill_all 0]
                                     [--seed 1] [--json FILE]

Six robots take jobs of two types, one of them exclusive. Every few seconds one of them is killed
(SIGKILL) and started again (--kill_every 0: none is); with --kill_all also the whole team that many
times. The figures come from the client, from the team's facts and from events.jsonl:

acknowledged  the time from the submission to the answer that a majority of the journals holds it
lost          acknowledged jobs that have not ended at the end, or of which nothing is known
twice         exclusive jobs whose work ended with success more than once
The exit status is 1 if anything was lost, or done twice.
"""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import anyio

from benchmarks.report import ROOT, run_program, say
from benchmarks.run import Run
from mrbt_mesh.runtime.team_client import TeamClient, connect

PROGRAM = """
import anyio
from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)

@robot.local_task("*")
async def do(task: TaskContext, number: str) -> None:
    await anyio.sleep(task.simulation.duration_s)
"""
MISSION = """
mission: submissions
program: robot.py
ends: never
local_tasks:
  plain: {parameters: [number], work: 0.1}
  dose: {parameters: [number], work: 0.1}
robot_types: {arm: {capabilities: {plain: 1, dose: 1}}}
robots: {A1: arm, A2: arm, A3: arm, A4: arm, A5: arm, A6: arm}
global_tasks:
  do: {parameters: [number], needs: {plain($number): {}}}
  dose: {parameters: [number], needs: {dose($number): {}}, exclusive: true, in_doubt: fail}
jobs:
  plain: {parameters: {number: {min: 1, max: 1000000}}, tree: do($number)}
  once: {parameters: {number: {min: 1, max: 1000000}}, tree: dose($number)}
tree: {Jobs: all}
"""
ROBOTS, HEARD_S = 6, 0.1
RESTART_S = 1.0
END_S = 120.0


class Handover:
    """One run: the jobs that were acknowledged, and how long that took."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder = folder
        self.draw = random.Random(seed)
        (folder / "robot.py").write_text(PROGRAM)
        self.mission = folder / "mission.yaml"
        self.mission.write_text(MISSION)
        self.took_s: list[float] = []
        self.acknowledged: list[str] = []
        self.unanswered: list[str] = []
        self.kills = 0

    def up(self, *options: str) -> Run:
        """The team, once all its robots have a process."""
        run = Run(self.folder, self.mission, *options)
        run.wait_for_processes(ROBOTS)
        return run

    async def submit_all(self, client: TeamClient, numbers: range, rate: float) -> None:
        """Hand in jobs of these numbers, this many a second."""
        begun_s = time.monotonic()
        async with anyio.create_task_group() as group:
            for position, number in enumerate(numbers):
                await anyio.sleep(max(0, begun_s + position / rate - time.monotonic()))
                group.start_soon(self._submit, client, number)

    async def _submit(self, client: TeamClient, number: int) -> None:
        name, kind = f"job-{number}", "once" if number % 3 == 0 else "plain"
        begun_s = time.monotonic()
        try:
            await client.submit(kind, number, job_id=name)
        except TimeoutError:
            self.unanswered.append(name)
            return
        self.took_s.append(time.monotonic() - begun_s)
        self.acknowledged.append(name)

    async def kill_now_and_then(self, run: Run, every_s: float) -> None:
        """Kill one robot after the other, and start each again."""

        async def start_again(robot: str) -> None:
            await anyio.sleep(RESTART_S)
            command = [sys.executable, "-m", "mrbt_mesh", "join", robot]
            command += ["--run-dir", str(run.folder)]
            await anyio.run_process(command, check=False, cwd=ROOT)

        async with anyio.create_task_group() as group:
            while True:
                await anyio.sleep(every_s)
                robots = run.processes()
                victim = self.draw.choice(sorted(robots))
                robots[victim].kill()
                self.kills += 1
                group.start_soon(start_again, victim)

    async def wait_for_ends(self, client: TeamClient) -> list[str]:
        """Those that have not ended in time."""
        left = dict.fromkeys(self.acknowledged)
        with anyio.move_on_after(END_S):
            for name in self.acknowledged:
                await client.wait_for_end(name)
                del left[name]
        return list(left)


def measure(
    count: int = 1_000, rate: float = 20, kill_every: float = 5, kill_all: int = 0, seed: int = 1
) -> dict[str, Any]:
    """Hand in `count` jobs, `rate` a second."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        work = Handover(Path(folder), seed)
        run, part = work.up(), -(-count // (kill_all + 1))
        lost: list[str] = []

        async def hand_in(numbers: range) -> None:
            async with connect(run.folder) as client, anyio.create_task_group() as group:
                while len(client.robots) < ROBOTS:
                    await anyio.sleep(HEARD_S)
                if kill_every:
                    group.start_soon(work.kill_now_and_then, run, kill_every)
                await work.submit_all(client, numbers, rate)
                group.cancel_scope.cancel()

        async def wait() -> None:
            async with connect(run.folder) as client:
                lost.extend(await work.wait_for_ends(client))

        for first in range(1, count + 1, part):
            if first > 1:
                run.kill()
                run.end()
                run = work.up("--continue")
            anyio.run(hand_in, range(first, min(first + part, count + 1)))
            say(f"{len(work.acknowledged)} of {count} acknowledged, {work.kills} robots killed")
        anyio.run(wait)
        subprocess.run(
            [sys.executable, "-m", "mrbt_mesh", "down", "--run-dir", str(run.folder)],
            cwd=ROOT,
            check=False,
            capture_output=True,
        )
        run.end()
        ends = [event for event in run.events() if event.get("outcome") == "success"]
    done = Counter(e["activation"] for e in ends if e["local_task"] == "dose")
    times_ms = sorted(round(1_000 * each, 1) for each in work.took_s)
    return {
        "jobs": count,
        "acknowledged": len(work.acknowledged),
        "unanswered": len(work.unanswered),
        "median_ms": times_ms[len(times_ms) // 2],
        "p99_ms": times_ms[len(times_ms) * 99 // 100],
        "robots_killed": work.kills,
        "teams_killed": kill_all,
        "lost": len(lost),
        "twice": sum(times > 1 for times in done.values()),
    }


if __name__ == "__main__":
    found = run_program(__doc__, measure)
    raise SystemExit(1 if found["lost"] or found["twice"] else 0)
