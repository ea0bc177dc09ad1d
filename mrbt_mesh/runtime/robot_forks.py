"""Robots of a team, forked from one process: the client side of `cli/fork_server.py`.

A robot that starts by exec takes four times as much processor time, nearly all of it for loading
the same modules again, and most of its memory is the same as that of the other robots.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

import psutil

from mrbt_mesh.runtime.run_dir import RunDir, RunDirError

# On other systems, a fork without exec may break state of the system's libraries.
CAN_FORK = sys.platform == "linux"
CHUNK = 1 << 16
# The server reports the end of a robot at once; this is the limit for a server that hangs.
NEWS_TIMEOUT_S = 10.0
START_TIMEOUT_S = 120.0
# How often a start checks whether another thread has read the awaited message.
LOOK_S = 0.1


class ForkedRobot:
    """A forked robot's process. Its parent is the fork server, which reports how it ended."""

    def __init__(self, forks: RobotForks, pid: int) -> None:
        self._forks = forks
        self.pid = pid
        self.status: int | None = None

    @property
    def returncode(self) -> int | None:
        """The exit status as far as known, negative for a signal.

        None if it is not known to have ended.
        """
        if self.status is None:
            self._forks.take_news(0)
        return self.status

    def settle(self) -> None:
        """Wait for the status of a robot that has ended."""
        while self.returncode is None and not self._runs():
            if not self._forks.take_news(NEWS_TIMEOUT_S):
                return

    def _runs(self) -> bool:
        try:
            return psutil.Process(self.pid).status() != psutil.STATUS_ZOMBIE
        except psutil.Error:
            return False


class RobotForks:
    """Starts robots through the fork server. Call `close` once they have ended."""

    def __init__(self, run_dir: RunDir, environment: Mapping[str, str], arrays: bool) -> None:
        """`environment` is added to the environment of this process for the robots.

        `arrays`: they will solve large assignment problems.
        """
        self._run_dir = run_dir
        self._waiting = b""
        self._reading = threading.Lock()
        self._robots: dict[int, ForkedRobot] = {}
        self._started: dict[str, ForkedRobot] = {}
        command = [sys.executable, "-m", "mrbt_mesh.cli.fork_server", str(run_dir.path)]
        with run_dir.opened_output(run_dir.fork_server_output_path) as output:
            # In its own session, so that keys pressed in the terminal reach only the launcher.
            self._server = subprocess.Popen(
                [*command, *(["arrays"] if arrays else [])],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=output,
                env=os.environ | environment,
                start_new_session=True,
                bufsize=0,
            )

    def start(self, arguments: Mapping[str, Sequence[str]]) -> dict[str, ForkedRobot]:
        """Start robots with these arguments of `mrbt`; block until they have their pids.

        Raises RunDirError if the fork server cannot start them.
        """
        assert self._server.stdin is not None
        for robot in arguments:
            self._started.pop(robot, None)  # its earlier process
        requests = [
            {"robot": robot, "arguments": [*words], "output": str(self._run_dir.output_path(robot))}
            for robot, words in arguments.items()
        ]
        try:
            for request in requests:
                self._server.stdin.write(json.dumps(request).encode() + b"\n")
        except BrokenPipeError:
            pass  # the server has ended, which is noticed below
        until_s = time.monotonic() + START_TIMEOUT_S
        while not self._started.keys() >= arguments.keys():
            is_there = self.take_news(LOOK_S) or self._server.poll() is None
            if not is_there or time.monotonic() > until_s:
                path = self._run_dir.fork_server_output_path
                raise RunDirError(f"the robots cannot be started: {path} may say why")
        return {robot: self._started[robot] for robot in arguments}

    def take_news(self, timeout_s: float) -> bool:
        """Read messages from the fork server for up to `timeout_s`. Returns whether any arrived.

        Several threads may call it.
        """
        assert self._server.stdout is not None
        if self._server.stdout.closed:
            return False
        poll = select.poll()
        poll.register(self._server.stdout, select.POLLIN)
        if not poll.poll(1e3 * timeout_s):
            return False
        with self._reading:
            if not poll.poll(0):
                return True  # another thread has just read it
            data = os.read(self._server.stdout.fileno(), CHUNK)
            *lines, self._waiting = (self._waiting + data).split(b"\n")
            for line in lines:
                self._take(json.loads(line))
        return bool(data)

    def _take(self, news: dict[str, Any]) -> None:
        if "status" in news:
            self._robots[news["pid"]].status = news["status"]
        else:
            robot = ForkedRobot(self, news["pid"])
            self._robots[robot.pid] = self._started[news["robot"]] = robot

    def close(self) -> None:
        """End the fork server; robots that still run are not affected."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.close()
        while self.take_news(NEWS_TIMEOUT_S):
            pass
        self._server.stdout.close()
        self._server.wait()
