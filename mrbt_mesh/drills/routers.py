"""The routers of a drill: real processes on loopback, which are killed like robots."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.launcher import free_endpoints


class RoutersError(InputError):
    """A router does not start; the message has its output."""


class DrillRouters:
    """A number of routers, numbered from 1 on; each connects to those before it.

    `endpoints`: what robots are given, in the order in which they try them.
    """

    def __init__(self, count: int) -> None:
        self.endpoints = free_endpoints(count, "tcp")
        self._processes: dict[int, subprocess.Popen[str]] = {}

    def start(self, number: int) -> None:
        """Start a router, possibly one that was killed, and wait until it routes."""
        command = [sys.executable, "-m", "mrbt_mesh", "router"]
        command += ["--listen", self.endpoints[number - 1]]
        for endpoint in self.endpoints[: number - 1]:
            command += ["--connect", endpoint]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self._processes[number] = process
        assert process.stdout is not None
        said = []
        for line in process.stdout:
            if line.startswith("running"):
                return
            said.append(line.strip())
        self.kill(number)
        raise RoutersError(f"router {number} has ended: {' '.join(said)}")

    def kill(self, number: int) -> bool:
        """Kill a router by SIGKILL. Returns False if it did not run."""
        process = self._processes.pop(number, None)
        if process is None:
            return False
        with process:  # waits for its end, and closes what it wrote to
            has_run = process.poll() is None
            process.kill()
        return has_run

    def signal(self, number: int, what: signal.Signals) -> None:
        """Stop a router's process (SIGSTOP), or let it go on."""
        process = self._processes.get(number)
        if process is not None:
            process.send_signal(what)

    def end(self) -> None:
        """Kill the running routers."""
        for number in list(self._processes):
            self.kill(number)


@contextmanager
def routers(count: int) -> Iterator[DrillRouters | None]:
    """Run the routers of a drill; yields None if there are none. Raises RoutersError."""
    if not count:
        yield None
        return
    found = DrillRouters(count)
    try:
        for number in range(1, count + 1):
            found.start(number)
        yield found
    finally:
        found.end()
