"""Honest runs with all that once made `verify` accuse honest teams: how many it accuses now.

    python -m benchmarks.honest_recordings [--runs 60] [--real 3] [--seed 0]

Simulated runs of examples and of generated missions: revisions that make robots leave and come,
leaves, frozen and suspended robots, event loops that are blocked for seconds, kills, cuts, and
recordings in parts whose first ones are removed. Then keyed teams of real processes whose tasks
block their event loop with `time.sleep`, are revised, left and killed. Exit status 1 for a
contradiction, or a gap other than an end that no other robot was left to notice.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.report import CORES, grid, in_processes, run_program, say
from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.metadata import OBSERVER
from mrbt_mesh.sim import AgentOptions, Freeze, Kill, Leave, Restart, Schedule, Thaw, simulate
from mrbt_mesh.sim.world.faults import Block, Fault, Revise, Slow, Suspend, Unblock
from mrbt_mesh.views.replay.findings import GapKind, Verification
from mrbt_mesh.views.replay.verify import verify
from tests.support.keys import keys_of
from tests.support.recorded import read_all
from tests.support.runs import example, source

S = 1_000_000
MRBT = (sys.executable, "-m", "mrbt_mesh")
EXAMPLES = ("vehicle_repair", "explore", "dispense", "generated")
KINDS = ("revise", "leave", "freeze", "suspend", "block", "kill", "cut")
# Below the size of a run, so that first parts are removed.
LIMITS = (None, 3_000_000, 560_000)


def measure(runs: int = 60, real: int = 3, seed: int = 0) -> dict[str, Any]:
    """Count: simulated runs, and runs of real processes."""
    with tempfile.TemporaryDirectory(prefix="mrbt-honest-") as name:
        folder = Path(name)
        calls = [(each, partial(_simulated, each, folder)) for each in range(seed, seed + runs)]
        rows = sorted(in_processes(calls, CORES))
        found = [(f"seed {each}", *row) for each, row in rows]
        found += [(f"real {each}", *_real(each, folder / f"real-{each}")) for each in range(real)]
    alarms = [(name, what, doubts) for name, what, doubts, _ in found if doubts]
    for name, _, doubts in alarms:
        say(f"{name}: {doubts}")
    unseen = sum(bool(ends) for *_, ends in found)
    table = grid(("run", "what happened", "doubts"), [row[:3] for row in found])
    text = f"{len(found)} honest runs: {len(alarms)} accused; in {unseen} an end that nobody saw."
    return {"tables": {"honest": f"{text}\n\n{table}"}, "runs": len(found), "alarms": alarms}


def _doubts(verdict: Verification) -> tuple[str, str]:
    """What accuses somebody, and how many ends nobody was left to notice."""
    gaps = [gap for gap in verdict.gaps if gap.kind is not GapKind.END]
    ends = len(verdict.gaps) - len(gaps)
    return "; ".join(map(str, [*verdict.findings[:3], *gaps[:3]])), str(ends or "")


# -- in virtual time ------------------------------------------------------------------------------


def _simulated(seed: int, folder: Path) -> tuple[str, str, str]:
    """(What happened, doubts, unseen ends) of a run."""
    draw = random.Random(seed)
    name = EXAMPLES[seed % len(EXAMPLES)]
    mission, program = source(None).load(seed) if name == "generated" else example(name)
    keys = keys_of(*mission.robots, observer="eye")
    limit = draw.choice(LIMITS)
    options = AgentOptions(keys={**keys, OBSERVER: keys["eye"]}, record_limit_bytes=limit)
    schedule = sorted(_faults(mission, draw), key=lambda step: step[0])
    with tempfile.TemporaryDirectory(dir=folder) as run:
        simulate(
            mission,
            program,
            seed=seed,
            schedule=schedule,
            agents=options,
            record=Path(run),
            timeout_us=40 * S,
        )
        verdict = verify(read_all(Path(run)), keys["eye"].manifest)
    events = ", ".join(type(fault).__name__.lower() for _, fault in schedule)
    return (f"{name}: {events}", *_doubts(verdict))


def _faults(mission: Mission, draw: random.Random) -> Iterator[tuple[int, Fault]]:
    robots = sorted(mission.robots)
    for kind in draw.sample(KINDS, draw.randint(2, 4)):
        robot, at_us = draw.choice(robots), draw.randint(S, 12 * S)
        end_us = at_us + draw.randint(S // 5, 6 * S)
        yield from _of(kind, robot, at_us, end_us, mission, draw)


def _of(
    kind: str, robot: str, at_us: int, end_us: int, mission: Mission, draw: random.Random
) -> Schedule:
    robots = sorted(mission.robots)
    others = [each for each in robots if each != robot]
    match kind:
        case "revise":
            left = {name: one for name, one in mission.robots.items() if name != robot}
            by = draw.choice(others)
            text = compile_mission(replace(mission, robots=left))
            try:
                mission_from_compiled(text, "revision")
            except InputError:
                return []  # the mission needs the robot: it has a place, or an entry
            away = Revise(by, text, True)
            return [(at_us, away), (end_us, Revise(by, compile_mission(mission), True))]
        case "leave":
            return [(at_us, Leave(robot))]
        case "freeze":
            return [(at_us, Freeze(robot)), (end_us, Thaw(robot))]
        case "suspend":
            return [(at_us, Suspend(robot)), (end_us, Thaw(robot))]
        case "block":
            lag_us = draw.choice([S // 3, S, 5 * S // 2])
            return [(at_us, Slow(robot, lag_us)), (end_us, Slow(robot, 0))]
        case "kill":
            return [(at_us, Kill(robot)), (end_us, Restart(robot))]
    links = frozenset({(robot, each) for each in others} | {(each, robot) for each in others})
    return [(at_us, Block(links)), (end_us, Unblock(links))]


# -- real processes -------------------------------------------------------------------------------

PROGRAM = """
import random
import time

import anyio

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram()


@robot.local_task("*")
async def work(task: TaskContext, *arguments: str) -> None:
    await anyio.sleep(0.3)
    time.sleep(random.choice([0.2, 0.8, 2.5]))
    await anyio.sleep(0.3)
"""
FILE = """
mission: sleepy
program: prog.py
local_tasks: {{scan: {{parameters: [part], work: 1}}}}
robot_types: {{t: {{capabilities: {{scan: 1}}}}}}
robots: {{{robots}}}
global_tasks:
  look: {{parameters: [part], needs: {{scan($part): {{min: 1, max: 1}}}}}}
tree:
  Parallel: [{tasks}]
"""


def _mission(path: Path, robots: str, parts: str) -> Path:
    listed = ", ".join(f"{robot}: t" for robot in robots.split())
    path.write_text(FILE.format(robots=listed, tasks=", ".join(f"look({each})" for each in parts)))
    return path


def _real(number: int, folder: Path) -> tuple[str, str, str]:
    """A team that blocks its loops, is revised so that a robot leaves, and loses another one."""
    folder.mkdir()
    (folder / "prog.py").write_text(PROGRAM)
    begun = _mission(folder / "m.yaml", "R1 R2 R3 R4", "abcdefgh")
    after = _mission(folder / "after.yaml", "R1 R2 R3", "abcdefghij")
    environment, run = os.environ | {"MRBT_STATE_DIR": str(folder)}, folder / "run"
    words = ("up", str(begun), "--run-dir", str(run), "--headless", "--timeout", "90")
    with subprocess.Popen([*MRBT, *words], env=environment, stdout=subprocess.DEVNULL) as team:
        while not (run / "R4.process").exists():
            time.sleep(0.2)
        for command in (("revise", str(after), "--force"), ("kill", "R2"), ("join", "R2")):
            time.sleep(number + 1)
            told = [*MRBT, *command, "--run-dir", str(run)]
            subprocess.run(told, env=environment, check=False, capture_output=True)
        team.wait()
    told = [*MRBT, "recording", "verify", str(run), "--json"]
    done = subprocess.run(told, env=environment, stdout=subprocess.PIPE, check=False)
    verdict = json.loads(done.stdout)
    doubts = [each["text"] for each in verdict["findings"][:3]]
    gaps = [each for each in verdict["not_proved"] if each["kind"] != "end"]
    ends = len(verdict["not_proved"]) - len(gaps)
    text = "; ".join([*doubts, *(each["text"] for each in gaps[:3])])
    return "time.sleep, revise, kill, join", text, str(ends or "")


if __name__ == "__main__":
    found = run_program(__doc__, measure)
    raise SystemExit(1 if found["alarms"] else 0)
