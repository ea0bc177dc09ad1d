"""What recording costs a robot: its share of the processor time of the robot's own process.

    python -m benchmarks.recording [--robots 6] [--seconds 20] [--json FILE]

A team of real processes over Zenoh works without end, so that its plan changes some ten times a
second; each robot reports its position ten times a second. Each robot measures the time that its
recorder takes, beside the time of its whole process: the ratio is that of one run, so it does not
depend on the machine's speed and load.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from benchmarks.missions import write_patrol
from benchmarks.report import ROOT, run_program
from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.recording.channels import PLANS
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.launcher import free_endpoints

# Each piece of work; it makes for some ten plan changes a second.
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


def robot(measured: Path, arguments: list[str]) -> NoReturn:
    """Be a robot, as `mrbt agent` is, and write down its recorder's time."""
    from mrbt_mesh.cli.main import main
    from mrbt_mesh.recording.robot_recorder import RobotRecorder

    spent_s = 0.0
    end = os._exit

    def timed(method: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: Any) -> None:
            nonlocal spent_s
            begun_s = time.thread_time()
            method(*arguments)
            spent_s += time.thread_time() - begun_s

        return call

    def written(code: int) -> NoReturn:
        figures = {"recorder_s": spent_s, "process_s": time.process_time() - before_s}
        measured.write_text(json.dumps(figures))
        end(code)

    for name in ("step", "_planned"):
        setattr(RobotRecorder, name, timed(getattr(RobotRecorder, name)))
    os._exit = written  # type: ignore[assignment]
    sys.argv = ["mrbt", *arguments]
    before_s = time.process_time()
    main()
    raise SystemExit("a robot ends by itself")


def measure(robots: int = 6, seconds: float = 20.0) -> dict[str, Any]:
    """The shares of all robots of a team at work, and their plan changes a second."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        return measure_in(Path(folder), robots, seconds)


def measure_in(folder: Path, robots: int, seconds: float) -> dict[str, Any]:
    areas = [f"a{number}" for number in range(max(1, robots - 1))]
    names = [f"R{number}" for number in range(1, robots + 1)]
    street = {"kind": "street", "points": [[0, 0], [20, 10]]}
    places = {area: {"at": [1, 1], "mended": f"visit({area})"} for area in areas}
    mission = write_patrol(
        folder,
        names,
        areas,
        WORK_S,
        again=True,
        program=PROGRAM.format(agents=str(ROOT / "agents")),
        map={"lines": [street], "places": places},
    )
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
        # Recordings begin once the robots run, which takes a while on a busy machine.
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
        "plan_changes_per_s": sum(changes) / robots,
        "recorder_share": spent_s / whole_s,
        "highest_share": max(row["recorder_s"] / row["process_s"] for row in rows.values()),
        "process_share_of_a_core": whole_s / robots / seconds,
    }


def _plan_changes_per_s(path: Path) -> float:
    plans = [record.at_us for record in read_recording(path).records if record.topic == PLANS]
    return (len(plans) - 1) / ((plans[-1] - plans[0]) / 1e6)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measured"]:
        name, measured_in, *arguments = sys.argv[2:]
        robot(Path(measured_in) / f"{name}.measured", arguments)
    run_program(__doc__, measure)
