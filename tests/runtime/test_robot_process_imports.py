"""What a robot's process does not load: many are started at once, on small computers too."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from tests.support.paths import mission_file

# A robot from its command line to its end, and what it had loaded by then.
ROBOT = """
import json, os, sys

def end(code):
    print(json.dumps([code, sorted({name.partition(".")[0] for name in sys.modules})]), flush=True)
    exit_now(code)

exit_now, os._exit = os._exit, end
from mrbt_mesh.cli.main import main
main()
"""
# YAML and its checks; arrays and solvers; what only people see; keys; other processes; metadata;
# what only extras need.
HEAVY = {
    *("pydantic", "pydantic_core", "ruamel", "numpy", "ortools", "rich", "pygments"),
    *("cryptography", "multiprocessing", "email", "importlib_metadata", "hypothesis"),
    *("prometheus_client", "wsgiref", "zmq", "starlette", "uvicorn", "textual", "foxglove"),
    *("aiomqtt", "paho", "py_trees", "mujoco", "rclpy"),
}


@pytest.mark.parametrize("name", ["explore", "couriers", "inspection"])
def test_a_robot_of_a_small_mission_loads_nothing_heavy(name: str, tmp_path: Path) -> None:
    """Alone it carries the whole mission out, with the program that belongs to it."""
    compiled = tmp_path / "mission.json"
    mission = load_mission(mission_file(name))
    compiled.write_text(compile_mission(mission))
    robot = next(iter(mission.robots))
    command = [sys.executable, "-c", ROBOT, "agent", "--mission", str(compiled), "--robot", robot]
    command += ["--listen", "tcp/127.0.0.1:0", "--expect", robot, "--speed", "1000"]
    command += ["--run-dir", str(tmp_path), "--exit-when-done", "--insecure"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    code, loaded = json.loads(done.stdout)
    assert code == 0, done.stderr
    assert {"mrbt_mesh", "zenoh", "anyio"} <= set(loaded)
    # Its trees are in files of a plug-in, and importlib.metadata, which finds it, loads `email`.
    allowed = {"email"} if name == "inspection" else set()
    assert not HEAVY & set(loaded) - allowed
