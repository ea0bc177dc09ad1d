"""The virtual robots that `mrbt new --ros2` writes, each a process of rclpy of its own.

They print one line for each start, end and cancellation.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mrbt_mesh.adapters.program_kinds import ROS2
from mrbt_mesh.adapters.ros2.binding_file import PYTHON_VARIABLE
from tests.support.heard import Heard

SCRIPT = ROS2.template / "virtual_robots.py"


def lacking() -> str:
    """Why there can be no such robots, and how to get them; empty if there can."""
    if not Path(os.environ.get(PYTHON_VARIABLE, "")).is_file():
        return f"{PYTHON_VARIABLE} names no Python with rclpy: make test-ros2"
    return ""


def free_domain() -> int:
    """A domain of ROS that other tests of this machine do not use."""
    return 100 + os.getpid() % 100


class VirtualRobots:
    """Processes of virtual robots in a domain of their own. Ended whatever happens.

    `environment`: the variables by which other processes reach them.
    """

    def __init__(self, folder: Path, script: Path = SCRIPT) -> None:
        self.folder = folder
        self.environment = {"ROS_DOMAIN_ID": str(free_domain())}
        self._script = script
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._all: list[subprocess.Popen[str]] = []
        self._heard = Heard[dict[str, Any]]()
        self.said = self._heard.messages

    def use(self, script: Path) -> None:
        """Take the robots of another file, which are those of `mrbt new`, changed."""
        self._script = script

    def __enter__(self) -> VirtualRobots:
        return self

    def __exit__(self, *error: object) -> None:
        for process in self._all:
            if process.poll() is None:
                process.kill()
            process.communicate()

    def start(self, *robots: str) -> None:
        """Start robots, and wait until each is ready."""
        count = len(self.said)
        for robot in robots:
            with (self.folder / f"virtual-{robot}.log").open("a") as log:
                process = subprocess.Popen(
                    [os.environ[PYTHON_VARIABLE], str(self._script), robot],
                    env=os.environ | self.environment,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    text=True,
                )
            self._processes[robot] = process
            self._all.append(process)
            threading.Thread(target=self._listen, args=(process,), daemon=True).start()
        for robot in robots:
            self.wait_for(lambda e, r=robot: (e["robot"], e["event"]) == (r, "ready"), count)

    def kill(self, robot: str) -> float:
        """SIGKILL; returns when."""
        return self.signal(robot, signal.SIGKILL)

    def signal(self, robot: str, number: signal.Signals) -> float:
        """Send a signal; returns when."""
        self._processes[robot].send_signal(number)
        return time.time()

    def _listen(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            self._heard.add(json.loads(line))

    def wait_for(self, holds: Callable[[dict[str, Any]], bool], after: int = 0) -> dict[str, Any]:
        """The first line that `holds` accepts among those from number `after` on."""
        return self._heard.wait_for(holds, "from a robot", after)

    def events(self, event: str) -> list[dict[str, Any]]:
        """All lines of a kind."""
        return [each for each in self.said if each["event"] == event]
