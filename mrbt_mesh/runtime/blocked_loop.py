"""Reports what blocks a robot's event loop: at once on its machine, afterwards to the team."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable

from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.inputs import ProblemFound
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.runtime.robot_loop import LoopWatchdog, blocking_place
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.task_port import Host
from mrbt_mesh.runtime.user_code import UserCall

SUBJECT = "event loop"
# Code that blocks the event loop for this long is reported.
BLOCK_LIMIT_S = 1.0


def loop_watchdog(
    host: Host, config: AgentConfig, run_dir: RunDir | None, step: Callable[[], int | None]
) -> LoopWatchdog:
    """Return a watchdog that names the code blocking a robot's loop before its team declares it
    dead.
    """
    limit_s = min(BLOCK_LIMIT_S, config.timing.detection_us / 2 / MICRO)
    loop = asyncio.get_running_loop()

    def write(text: str) -> None:
        if run_dir is not None:
            run_dir.write_blocked(config.robot, text)

    def blocked(frames: list[tuple[str, int]]) -> None:
        """Called by the watchdog's thread when the loop has been blocked for `limit_s`."""
        place = blocking_place(UserCall.stepping, frames)
        if place is None:
            return  # this robot's own work, such as a plan for a large team
        since_s = time.monotonic() - limit_s
        host.log("error", "event_loop_blocked", by=place)
        write(f"{place} blocks it now")
        with contextlib.suppress(RuntimeError):  # the loop is closed: the robot has ended
            loop.call_soon_threadsafe(over, place, since_s)

    def over(place: str, since_s: float) -> None:
        """The loop runs again."""
        write("")
        blocked_s = time.monotonic() - since_s
        text = f"{place} blocked it for {blocked_s:.1f} s: use anyio.to_thread.run_sync"
        host.submit(ProblemFound(SUBJECT, text))

    write("")
    return LoopWatchdog(limit_s, step, blocked)
