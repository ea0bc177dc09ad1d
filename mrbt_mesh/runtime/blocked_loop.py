"""Tells of a robot whose event loop is blocked: at once on its own computer, then to the team."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.inputs import ProblemFound
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.runtime.robot_loop import LoopWatchdog, blocking_place
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.task_port import Host
from mrbt_mesh.runtime.user_code import UserCall

SUBJECT = "event loop"
# Code that keeps the event loop for so long is named.
BLOCK_LIMIT_S = 1.0


def loop_watchdog(
    host: Host, config: AgentConfig, run_dir: Path | None, step: Callable[[], int | None]
) -> LoopWatchdog:
    """What names the code that blocks a robot's event loop, before its team takes it for dead."""
    limit_s = min(BLOCK_LIMIT_S, config.timing.detection_us / 2 / MICRO)
    return LoopWatchdog(limit_s, step, BlockedLoop(host, config.robot, run_dir, limit_s))


class BlockedLoop:
    """Called by the watchdog's thread. `limit_s` is how long the loop has stood by then."""

    def __init__(self, host: Host, robot: str, run_dir: Path | None, limit_s: float) -> None:
        self._host = host
        self._robot = robot
        self._run_dir = None if run_dir is None else RunDir(run_dir)
        self._limit_s = limit_s
        self._loop = asyncio.get_running_loop()
        self._goes_on()

    def __call__(self, frames: list[tuple[str, int]]) -> None:
        what = blocking_place(UserCall.stepping, frames)
        if what is None:
            return  # this robot's own work, such as a plan for a large team
        since_s = time.monotonic() - self._limit_s
        self._host.log("error", "event_loop_blocked", by=what)
        if self._run_dir is not None:
            self._run_dir.write_blocked(self._robot, f"{what} blocks it now")
        with contextlib.suppress(RuntimeError):  # the loop is closed: the robot has ended
            self._loop.call_soon_threadsafe(self._over, what, since_s)

    def _over(self, what: str, since_s: float) -> None:
        """The loop runs again."""
        self._goes_on()
        blocked_s = time.monotonic() - since_s
        text = f"{what} blocked it for {blocked_s:.1f} s: use anyio.to_thread.run_sync"
        self._host.submit(ProblemFound(SUBJECT, text))

    def _goes_on(self) -> None:
        if self._run_dir is not None:
            self._run_dir.write_blocked(self._robot, "")
