"""Failure models: robots that die and lose capabilities by chance, and actions that fail.

Where a schedule says what happens when, a model says how likely it is. All draws come from the
seed of the run, one stream per robot and purpose.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from mrbt_mesh.core.agent.inputs import ActionFinished
from mrbt_mesh.core.mission.mission import Mission, Robot, type_name
from mrbt_mesh.sim.engine import faults
from mrbt_mesh.sim.engine.process import SimProcess

if TYPE_CHECKING:
    from mrbt_mesh.sim.engine.world import World

HOUR_US = 3_600_000_000
EVERYBODY = ""


@dataclass(frozen=True, slots=True)
class Rate:
    """How often something befalls a robot: with a chance (0 to 1) each time it completes an
    action, and so many times per hour on the average, at times that know nothing of each other.
    """

    per_action: float = 0.0
    per_hour: float = 0.0


@dataclass(frozen=True)
class FailureModel:
    """What goes wrong how often.

    `major` (death) and `minor` (a capability is lost, any of those that are left alike) map a
    robot, a robot type or EVERYBODY to a rate; the most specific one counts. `actions` maps a
    local-task type or EVERYBODY to the chance that the action fails. `major_faults` different
    robots die, and `minor_faults` different capabilities of robots are lost, at random times
    within the first `within_us`. `return_us` after its death a robot is started again with its
    journal, `repair_us` after its loss a capability is back; None: never.
    """

    major: Mapping[str, Rate] = field(default_factory=dict)
    minor: Mapping[str, Rate] = field(default_factory=dict)
    actions: Mapping[str, float] = field(default_factory=dict)
    major_faults: int = 0
    minor_faults: int = 0
    within_us: int = 0
    return_us: int | None = None
    repair_us: int | None = None


NO_FAILURES = FailureModel()


def rate_of(rates: Mapping[str, Rate], robot: Robot) -> Rate:
    """The rate that counts for a robot."""
    for name in (robot.id, robot.type, EVERYBODY):
        if name in rates:
            return rates[name]
    return Rate()


def losable(mission: Mission) -> list[tuple[str, str]]:
    """All (robot, capability) pairs that minor faults can take away, sorted."""
    return [
        (r.id, name) for _, r in sorted(mission.robots.items()) for name in sorted(r.capabilities)
    ]


class Failures:
    """Lets a model's failures befall one run. `awaited`: how many returns and repairs are due."""

    def __init__(self, world: World, model: FailureModel) -> None:
        self.awaited = 0
        self._world = world
        self._model = model
        self._streams: dict[tuple[str, str], random.Random] = {}
        self._lost: defaultdict[str, set[str]] = defaultdict(set)

    def begin(self) -> None:
        """Schedule the faults of which there is a given number."""
        model, mission = self._model, self._world.mission
        if not model.major_faults and not model.minor_faults:
            return
        stream = self._stream("number", EVERYBODY)
        # Drawn in full, so that one more fault leaves those before it as they were.
        robots = sorted(self._world.setup.robots)
        stream.shuffle(robots)
        deaths = [(stream.randint(0, model.within_us), robot) for robot in robots]
        pairs = [pair for pair in losable(mission) if pair[0] in robots]
        stream.shuffle(pairs)
        losses = [(stream.randint(0, model.within_us), *pair) for pair in pairs]
        for at_us, robot in deaths[: model.major_faults]:
            self._world.clock.at(at_us, partial(self._die, robot))
        for at_us, robot, local_task in losses[: model.minor_faults]:
            self._world.clock.at(at_us, partial(self._lose, robot, local_task))

    def launched(self, process: SimProcess) -> None:
        """A robot's process starts: draw when it will die, and lose its first capability."""
        robot = self._robot(process.robot)
        self._later("death", process, rate_of(self._model.major, robot), self._death_comes)
        self._later("loss", process, rate_of(self._model.minor, robot), self._loss_comes)

    def outcome(self, process: SimProcess, event: ActionFinished) -> ActionFinished:
        """How an action that a robot has ended by itself counts."""
        action = process.agent.view.action if process.agent is not None else None
        if action is None or not event.success:
            return event
        chances = self._model.actions
        chance = chances.get(type_name(action.local_task), chances.get(EVERYBODY, 0.0))
        if not self._happens("action", process.robot, chance):
            return event
        return replace(event, success=False, data=None, conditions=(), error="failed by chance")

    def completed(self, process: SimProcess) -> None:
        """A robot has completed an action, and what came of it has been told."""
        robot, clock = self._robot(process.robot), self._world.clock
        if self._happens("death", robot.id, rate_of(self._model.major, robot).per_action):
            clock.at(clock.now_us, partial(self._die, robot.id))
        if self._happens("loss", robot.id, rate_of(self._model.minor, robot).per_action):
            clock.at(clock.now_us, partial(self._lose_any, robot.id))

    def _robot(self, robot: str) -> Robot:
        return self._world.mission.robots[robot]

    def _stream(self, purpose: str, robot: str) -> random.Random:
        stream = self._streams.get((purpose, robot))
        if stream is None:
            stream = random.Random(f"{self._world.setup.seed}/{purpose}/{robot}")
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
            self._world.clock.at(self._world.clock.now_us + wait_us, partial(event, process))

    def _death_comes(self, process: SimProcess) -> None:
        if not process.is_over:
            self._die(process.robot)

    def _loss_comes(self, process: SimProcess) -> None:
        if not process.is_over:
            self._lose_any(process.robot)
            rate = rate_of(self._model.minor, self._robot(process.robot))
            self._later("loss", process, rate, self._loss_comes)

    def _die(self, robot: str) -> None:
        process = self._world.processes.get(robot)
        if process is not None and process.is_over:
            return
        self._world.befall(faults.Kill(robot))
        if self._model.return_us is not None:
            self.awaited += 1
            clock = self._world.clock
            clock.at(clock.now_us + self._model.return_us, partial(self._return, robot))

    def _return(self, robot: str) -> None:
        self.awaited -= 1
        self._lost[robot].clear()
        self._world.befall(faults.Restart(robot))

    def _lose_any(self, robot: str) -> None:
        left = sorted(self._robot(robot).capabilities.keys() - self._lost[robot])
        if left:
            self._lose(robot, self._stream("which", robot).choice(left))

    def _lose(self, robot: str, local_task: str) -> None:
        lost, process = self._lost[robot], self._world.processes.get(robot)
        lives = process is not None and not process.is_over
        if local_task in lost or not (lives or self._world.is_coming(robot)):
            return
        lost.add(local_task)
        self._world.befall(faults.Lose(robot, local_task))
        if self._model.repair_us is not None:
            self.awaited += 1
            clock = self._world.clock
            clock.at(clock.now_us + self._model.repair_us, partial(self._repair, robot, local_task))

    def _repair(self, robot: str, local_task: str) -> None:
        self.awaited -= 1
        if local_task in self._lost[robot]:  # a new life has all its capabilities
            self._lost[robot].discard(local_task)
            self._world.befall(faults.Restore(robot, local_task))
