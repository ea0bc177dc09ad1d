"""Run directories without a run: what commands find of one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.process_identity import identity_of
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import new_run
from tests.support.paths import mission_file


def a_run(path: Path, pids: Mapping[str, int], example: str = "explore") -> RunDir:
    """The directory of a run whose robots have these processes; 0: one that is over."""
    mission = load_mission(mission_file(example))
    options = RobotOptions(program="p.py", beat_s=0.1, detection_s=0.5)
    info = new_run(mission, mission_file(example), sorted(mission.robots), options)
    run_dir = RunDir.create(path, info, compile_mission(mission))
    for robot, pid in pids.items():
        text = identity_of(pid) if pid else '{"pid": 1, "started": ""}'
        (path / f"{robot}.process").write_text(text)
    return run_dir
