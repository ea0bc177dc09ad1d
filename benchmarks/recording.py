"""What recording costs a robot: its share of the processor time of the robot's own process.

    python -m benchmarks.recording [--robots 6] [--seconds 20] [--json FILE]

A team of real processes over Zenoh works without end, so that its plan changes some ten times a
second; each robot says ten times a second where it is. Each robot measures the time that its
recorder takes, beside the time of its whole process: the ratio comes of one run, so it does not
matter how fast the machine is or what else it does.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NoReturn

from benchmarks.report import script_parser
from benchmarks.run import ROOT, machine, say, tell
from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.recording.channels import PLANS
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.launcher import free_endpoints

# So long each robot works at a time: some ten plan changes a second come of it.
WORK_S = 1.8
# The robots of examples/explore, on their way.
PROGRAM = """\
import sys

import anyio

from mrbt_mesh import RobotContext

sys.path.insert(0, {agents!r})
from explore import robot


@robot.background
async def drive(context: RobotContext) -> None:
    at = 0
    while True:
        at += 1
        context.report_position(at / 10, at / 20, heading=at / 100)
        await anyio.sleep(0.1)
"""
MISSION = """\
mission: busy
program: {program}
parameters:
  areas: [{areas}]
  map: {{lines: [{{kind: street, points: [[0, 0], [20, 10]]}}], places: {{{places}}}}}
local_tasks: {{explore: {{parameters: [area], work: {work}}}}}
robot_types: {{R: {{capabilities: {{explore: 1}}}}}}
robots: {{{robots}}}
global_tasks:
  explore_area: {{parameters: [area], needs: {{explore($area): {{min: 1, max: 1}}}}}}
tree:
  Parallel:
    success: all
    for_each: {{area: $areas}}
    do: {{Repeat: {{cycles: -1, do: explore_area($area)}}}}
"""


def robot(measured: Path, arguments: list[str]) -> NoReturn:
    """Be a robot, as `mrbt agent` is, and write down what its recorder took."""
    from mrbt_mesh.cli.main import main
    from mrbt_mesh.recording.robot_recorder import RobotRecorder

    spent_s = 0.0
    step, planned, end = RobotRecorder.step, RobotRecorder._planned, os._exit

    def timed_step(self: RobotRecorder, event: Input, effects: list[Effect], now_us: int) -> None:
        nonlocal spent_s
        begun_s = time.thread_time()
        step(self, event, effects, now_us)
        spent_s += time.thread_time() - begun_s

    def timed_plan(self: RobotRecorder, *said: Any) -> None:
        nonlocal spent_s
        begun_s = time.thread_time()
        planned(self, *said)
        spent_s += time.thread_time() - begun_s

    def written(code: int) -> NoReturn:
        figures = {"recorder_s": spent_s, "process_s": time.process_time() - before_s}
        measured.write_text(json.dumps(figures))
        end(code)

    RobotRecorder.step = timed_step  # type: ignore[assignment, method-assign]
    RobotRecorder._planned = timed_plan  # type: ignore[assignment, method-assign]
    os._exit = written  # type: ignore[assignment]
    sys.argv = ["mrbt", *arguments]
    before_s = time.process_time()
    main()
    raise SystemExit("a robot ends by itself")


def measure(folder: Path, robots: int, seconds: float) -> dict[str, Any]:
    """Let a team work for so long: the shares of all robots, and their plan changes a second."""
    areas = [f"a{number}" for number in range(max(1, robots - 1))]
    names = [f"R{number}" for number in range(1, robots + 1)]
    mission, program = folder / "busy.yaml", folder / "busy.py"
    program.write_text(PROGRAM.format(agents=str(ROOT / "agents")))
    text = MISSION.format(
        program=program,
        areas=", ".join(areas),
        places=", ".join(f"{area}: {{at: [1, 1], mended: explore_area({area})}}" for area in areas),
        robots=", ".join(f"{name}: R" for name in names),
        work=WORK_S,
    )
    mission.write_text(text)
    endpoints, keys = free_endpoints(robots, "tcp"), folder / "keys"
    KeyFolder.create(keys, dict.fromkeys(names, Role.ROBOT))
    running = []
    for index, name in enumerate(names):
        words = ["agent", "--mission", str(mission), "--robot", name, "--keys", str(keys)]
        words += ["--team", f"busy-{os.getpid()}", "--listen", endpoints[index]]
        for other in endpoints[:index]:
            words += ["--connect", other]
        words += ["--record", str(folder / f"{name}.mcap"), "--run-dir", str(folder)]
        command = [sys.executable, "-m", "benchmarks.recording", "--measured", name, str(folder)]
        running.append(subprocess.Popen([*command, *words], cwd=ROOT))
    records = [folder / f"{name}.mcap" for name in names]
    try:
        # Recordings begin once the robots are up, which takes a while on a busy machine.
        while not all(each.exists() for each in records) and not any(p.poll() for p in running):
            time.sleep(0.1)
        time.sleep(seconds)
    finally:
        for process in running:
            process.send_signal(signal.SIGTERM)
        ends = [process.wait(30) for process in running]
    if any(ends):
        raise RuntimeError(f"robots ended with exit statuses {ends}")
    rows = {name: json.loads((folder / f"{name}.measured").read_text()) for name in names}
    changes = [_plan_changes_per_s(each) for each in records]
    spent_s = sum(row["recorder_s"] for row in rows.values())
    whole_s = sum(row["process_s"] for row in rows.values())
    return {
        "robots": robots,
        "seconds": seconds,
        "plan_changes_per_s": sum(changes) / robots,
        "recorder_share": spent_s / whole_s,
        "highest_share": max(row["recorder_s"] / row["process_s"] for row in rows.values()),
        "process_share_of_a_core": whole_s / robots / seconds,
    }


def _plan_changes_per_s(path: Path) -> float:
    plans = [record.at_us for record in read_recording(path).records if record.topic == PLANS]
    return (len(plans) - 1) / ((plans[-1] - plans[0]) / 1e6)


def main() -> None:
    """Measure, and tell the figures."""
    if sys.argv[1:2] == ["--measured"]:
        name, folder, *arguments = sys.argv[2:]
        robot(Path(folder) / f"{name}.measured", arguments)
    parser = script_parser(__doc__)
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        found = measure(Path(folder), given.robots, given.seconds)
    say(f"{found['plan_changes_per_s']:.1f} plan changes a second")
    say(f"recording: {found['recorder_share']:.2%} of a robot's processor time")
    tell({"machine": machine(), **found}, given.json)


if __name__ == "__main__":
    main()
