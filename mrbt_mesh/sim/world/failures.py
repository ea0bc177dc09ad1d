"""Injects the faults of a failure model. All draws come from the seed of the run.

There is one stream per robot and purpose.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from mrbt_mesh.core.agent.inputs import ActionFinished
from mrbt_mesh.core.mission.mission import Robot
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.clock import VirtualClock
from mrbt_mesh.sim.world.process import SimProcess
from mrbt_mesh.sim.world.robots import Robots
from mrbt_mesh.sim.world.setup import EVERYBODY, Rate, Setup, rate_of

HOUR_US = 3_600_000_000


class RandomFailures:
    """Draws the failures of one run. `awaited`: how many returns and repairs are still to come.

    `inject` lets a fault happen.
    """

    def __init__(
        self,
        setup: Setup,
        clock: VirtualClock,
        robots: Robots,
        inject: Callable[[faults.Fault], None],
    ) -> None:
        self.awaited = 0
        self._setup = setup
        self._model = setup.failures
        self._clock = clock
        self._robots = robots
        self._inject = inject
        self._streams: dict[tuple[str, str], random.Random] = {}
        self._lost: defaultdict[str, set[str]] = defaultdict(set)

    def launched(self, process: SimProcess) -> None:
        """A robot's process starts: draw when it will die, and lose its first capability."""
        robot = self._robot(process.robot)
        self._later("death", process, rate_of(self._model.major, robot), self._death_comes)
        self._later("loss", process, rate_of(self._model.minor, robot), self._loss_comes)

    def outcome(self, process: SimProcess, event: ActionFinished) -> ActionFinished:
        """How an action that a robot has ended by itself counts."""
        action = process.agent.view.action if process.agent is not None else None
        if action is None or action.travel_to or not event.success:
            return event
        chances = self._model.actions
        chance = chances.get(type_name(action.local_task), chances.get(EVERYBODY, 0.0))
        if not self._happens("action", process.robot, chance):
            return event
        why = "failed by chance"
        return replace(event, success=False, conditions=(), error=why, reason=why)

    def completed(self, process: SimProcess) -> None:
        """A robot has completed an action, and has reported its outcome."""
        robot, clock = self._robot(process.robot), self._clock
        if self._happens("death", robot.id, rate_of(self._model.major, robot).per_action):
            clock.at(clock.now_us, partial(self._die, robot.id))
        if self._happens("loss", robot.id, rate_of(self._model.minor, robot).per_action):
            clock.at(clock.now_us, partial(self._lose_any, robot.id))

    def _robot(self, robot: str) -> Robot:
        return self._robots.descriptions[robot]  # a revision may have added it

    def _stream(self, purpose: str, robot: str) -> random.Random:
        stream = self._streams.get((purpose, robot))
        if stream is None:
            stream = random.Random(f"{self._setup.seed}/{purpose}/{robot}")
            self._streams[purpose, robot] = stream
        return stream

    def _happens(self, purpose: str, robot: str, chance: float) -> bool:
        return chance > 0 and self._stream(f"{purpose} per action", robot).random() < chance

    def _later(
        self, purpose: str, process: SimProcess, rate: Rate, event: Callable[[SimProcess], None]
    ) -> None:
        """Let `event` come after an exponentially distributed time of this life."""
        if rate.per_hour > 0:
            stream = self._stream(f"{purpose} per hour", process.robot)
            wait_us = round(stream.expovariate(rate.per_hour) * HOUR_US)
            self._clock.at(self._clock.now_us + wait_us, partial(event, process))

    def _death_comes(self, process: SimProcess) -> None:
        if not process.is_over:
            self._die(process.robot)

    def _loss_comes(self, process: SimProcess) -> None:
        if not process.is_over:
            self._lose_any(process.robot)
            rate = rate_of(self._model.minor, self._robot(process.robot))
            self._later("loss", process, rate, self._loss_comes)

    def _die(self, robot: str) -> None:
        process = self._robots.processes.get(robot)
        if process is not None and process.is_over:
            return
        self._inject(faults.Kill(robot))
        if self._model.return_us is not None:
            self.awaited += 1
            clock = self._clock
            clock.at(clock.now_us + self._model.return_us, partial(self._return, robot))

    def _return(self, robot: str) -> None:
        self.awaited -= 1
        self._lost[robot].clear()
        self._inject(faults.Restart(robot))

    def _lose_any(self, robot: str) -> None:
        left = sorted(self._robot(robot).capabilities.keys() - self._lost[robot])
        if left:
            self._lose(robot, self._stream("which", robot).choice(left))

    def _lose(self, robot: str, local_task: str) -> None:
        lost, process = self._lost[robot], self._robots.processes.get(robot)
        lives = process is not None and not process.is_over
        if local_task in lost or not (lives or self._robots.is_coming(robot)):
            return
        lost.add(local_task)
        self._inject(faults.Lose(robot, local_task))
        if self._model.repair_us is not None:
            self.awaited += 1
            clock = self._clock
            clock.at(clock.now_us + self._model.repair_us, partial(self._repair, robot, local_task))

    def _repair(self, robot: str, local_task: str) -> None:
        self.awaited -= 1
        if local_task in self._lost[robot]:  # a new life has all its capabilities
            self._lost[robot].discard(local_task)
            self._inject(faults.Restore(robot, local_task))
