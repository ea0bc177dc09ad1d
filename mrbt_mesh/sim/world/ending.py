"""When a run is over."""

from __future__ import annotations

from collections.abc import Callable

import anyio

from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.sim.world.robots import Robots
from mrbt_mesh.sim.world.setup import Setup

# How long, in detection times, robots that were cut off may outlive the end of the mission.
GIVE_UP_DETECTIONS = 5


class Ending:
    """Ends a run when the mission is over, when nothing can happen any more, or at its timeout.

    `is_awaited`: whether something is still to come that could help the team. `gave_up`: robots
    outlived the end of the mission. `error`: what broke.
    """

    def __init__(
        self, setup: Setup, robots: Robots, observer: Observer, is_awaited: Callable[[], bool]
    ) -> None:
        self.over = anyio.Event()
        self.timed_out = False
        self.gave_up = False
        self.error: Exception | None = None
        self._setup = setup
        self._robots = robots
        self._observer = observer
        self._is_awaited = is_awaited
        # The number of changes of the facts, and since when it is the same.
        self._stuck_since: tuple[int, int] = (0, 0)

    @property
    def has_result(self) -> bool:
        """Whether the mission is over."""
        return self._observer.record.result is not None

    def look(self) -> None:
        """End the run if nobody is left."""
        if self._nothing_left():
            self.over.set()

    def look_whether_stuck(self, now_us: int) -> None:
        """End the run if nothing more will come of it, where that was asked for."""
        if self._setup.stop_when_stuck and self._is_stuck(now_us):
            self.over.set()

    def time_out(self) -> None:
        self.timed_out = True
        self.over.set()

    def give_up(self) -> None:
        self.gave_up = True
        self.over.set()

    def fail(self, error: Exception) -> None:
        self.error = error
        self.over.set()

    def _nothing_left(self) -> bool:
        if self._robots.to_launch:
            return False  # they are still being launched
        if self.has_result:
            return not self._robots.living()
        return not self._is_awaited() and all(p.is_over for p in self._robots.processes.values())

    def _is_stuck(self, now_us: int) -> bool:
        """Whether nothing more will happen: for as long as a verdict on a robot may take, nobody
        has worked or had anything to do, no deadline ran, and no fact has changed.
        """
        changes = self._observer.facts.changes
        if self._is_awaited() or not self._rests():
            changes = -1
        if changes != self._stuck_since[0]:
            self._stuck_since = (changes, now_us)
        timing = self._setup.timing
        patience_us = timing.max_detection_us + timing.detection_us
        return changes >= 0 and self._stuck_since[1] + patience_us <= now_us

    def _rests(self) -> bool:
        living = self._robots.living()
        agents = [process.agent.view for process in living if process.agent]
        return not any(process.runs_by_itself for process in living) and all(
            not agent.is_joining
            and agent.plan is not None
            and not agent.plan.lines
            and agent.action is None
            and not agent.waits_for_deadline
            for agent in agents
        )
