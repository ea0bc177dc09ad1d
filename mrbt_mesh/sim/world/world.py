"""The simulated world: robots' processes, what is between them, faults, an observer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

import anyio
import anyio.abc

from mrbt_mesh.core.agent.effects import Ask, AskRouter, Publish, Reply, StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import OrderKind
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.mission import Mission, MissionEnd
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.recording.robot_recorder import RobotRecorder
from mrbt_mesh.runtime.actions import RobotIdentity
from mrbt_mesh.sim.world.clock import VirtualClock
from mrbt_mesh.sim.world.ending import GIVE_UP_DETECTIONS, Ending
from mrbt_mesh.sim.world.injector import Injector
from mrbt_mesh.sim.world.inspection import Inspection
from mrbt_mesh.sim.world.message_bus import MessageBus
from mrbt_mesh.sim.world.network import Network
from mrbt_mesh.sim.world.process import SimProcess
from mrbt_mesh.sim.world.program_tasks import run_program
from mrbt_mesh.sim.world.random_failures import RandomFailures
from mrbt_mesh.sim.world.recordings import Recordings
from mrbt_mesh.sim.world.robots import Robots
from mrbt_mesh.sim.world.routers import Routers
from mrbt_mesh.sim.world.setup import Setup


class World:
    """Everything that is there, and what happens when. One instance is one run.

    It stands between the parts: a process tells it what it does, and it tells those whom that
    concerns. `inspect` makes what checks it. `events`: what the robots have recorded themselves.
    `look_on` is shown the observer whenever that has seen something.
    """

    def __init__(self, setup: Setup, inspect: Inspect, look_on: LookOn | None = None) -> None:
        self.setup = setup
        self._look_on = look_on
        self.timing = setup.timing
        self.clock = VirtualClock()
        self.network = Network(setup.network, setup.seed)
        routers = Routers(setup.network.routers, setup.seed)
        self.bus = MessageBus(self.clock, self.network, routers, self._token_changed)
        self.robots = Robots(setup, self, self.bus)
        self.observer = Observer(
            setup.mission, setup.run, self.timing, default_solver, setup.agents.engine
        )
        self.ending = Ending(setup, self.robots, self.observer, self._is_awaiting)
        self.events: list[dict[str, Any]] = []
        self._under_way: dict[tuple[str, str, str], int] = {}
        if setup.begin is not None:
            self._under_way.update(setup.begin.under_way)
            self.observer.read(setup.begin.facts, self.clock.now_us)
        self.recordings: Recordings | None = None
        if setup.record is not None:
            self.recordings = Recordings(setup, setup.record, self.observer)
        self._is_observing = False
        self.inspection = inspect(self)
        self.injector = Injector(setup, self.bus, self.robots, self.inspection, self._has_result)
        self.failures = RandomFailures(setup, self.clock, self.robots, self.injector.inject)

    async def main(self) -> None:
        """Run until the mission is over, nothing can happen any more, or the timeout."""
        self.clock.on_error = self.ending.fail
        async with anyio.create_task_group() as group:
            self.robots.launch_all(partial(self._start_program, group))
            self.injector.begin()
            self.failures.begin()
            self.clock.at(self.setup.timeout_us, self.ending.time_out)
            self.clock.at(0, self._observe_regularly)
            await self.ending.over.wait()
            group.cancel_scope.cancel()
        if self.ending.error is not None:
            raise self.ending.error

    def _start_program(
        self, group: anyio.abc.TaskGroup, process: SimProcess, identity: RobotIdentity
    ) -> None:
        program, mission = self.setup.program, self.setup.mission
        group.start_soon(run_program, process, program, mission, identity, self.clock)

    # -- what others see of it (checkers.findings.View) ---------------------------------------

    @property
    def mission(self) -> Mission:
        return self.setup.mission

    @property
    def plan_delay_us(self) -> int:
        return self.setup.agents.plan_delay_us or 0

    @property
    def solver(self) -> Solver:
        return default_solver

    @property
    def speed(self) -> float:
        return self.setup.speed

    @property
    def cut_off(self) -> bool:
        """Whether some robot could not hear all others in time for a while."""
        return self.injector.cut_off

    @property
    def healed_us(self) -> int | None:
        """When all faults ended; None: not yet."""
        return self.injector.healed_us

    def living(self) -> list[SimProcess]:
        """Processes that run and are not frozen, sorted by robot."""
        return self.robots.living()

    def _has_result(self) -> bool:
        return self.ending.has_result

    def _is_awaiting(self) -> bool:
        """Whether something is still to come that could help the team."""
        return bool(self.injector.pending or self.failures.awaited)

    # -- what processes do (robots.TeamEnvironment) -------------------------------------------

    def without_journal(self, robot: str) -> None:
        self.inspection.lost_journal(robot)

    def launched(self, process: SimProcess) -> None:
        self.failures.launched(process)

    def killed(self, process: SimProcess) -> None:
        self.observer.record.exited(process.robot, self.clock.now_us)

    def published(self, process: SimProcess, effect: Publish) -> None:
        message = self.bus.publish(process.robot, effect)
        self.injector.heard(message)
        self.observer.message(effect.kind, process.robot, effect.data, self.clock.now_us)
        if effect.kind is MessageKind.FACT:
            self.inspection.published_facts()
        self._observe_soon()

    def asked(self, process: SimProcess, effect: Ask) -> None:
        self.bus.ask(process, effect)

    def asked_router(self, process: SimProcess, effect: AskRouter) -> None:
        self.bus.ask_router(process, effect)

    def replied(self, process: SimProcess, effect: Reply) -> None:
        self.bus.reply(process.robot, effect)

    def declared(self, process: SimProcess, incarnation: Incarnation) -> None:
        self.bus.declare(process.robot, incarnation)

    def stopped(self, process: SimProcess) -> None:
        plan = process.agent.view.plan if process.agent else None
        stands_by = (
            self.mission.ends is MissionEnd.NEVER and plan and plan.order is not OrderKind.ABORT
        )
        if plan and not stands_by and plan.result in (Status.SUCCESS, Status.FAILURE):
            # It has seen the whole team agree. Robots that it could not reach may never learn it.
            now_us = self.clock.now_us
            self.observer.record.over(plan.result, now_us)
            give_up_us = now_us + GIVE_UP_DETECTIONS * self.timing.detection_us
            self.clock.at(give_up_us, self.ending.give_up)
        self.bus.withdraw(process.robot)
        self.inspection.stopped()

    def outcome(self, process: SimProcess, event: ActionFinished) -> ActionFinished:
        return self.failures.outcome(process, event)

    def completed(self, process: SimProcess) -> None:
        self.robots.completed(process.robot)
        self.failures.completed(process)

    def recorded(self, process: SimProcess, event: Mapping[str, Any]) -> None:
        self.events.append(dict(event))

    def recorder_of(self, process: SimProcess) -> RobotRecorder | None:
        if self.recordings is None or process.agent is None:
            return None
        return self.recordings.begin(process.agent.view, self.clock.now_us)

    def begun_before_us(self, process: SimProcess, effect: StartAction) -> int:
        place = (process.robot, effect.activation, effect.local_task)
        return self._under_way.pop(place, 0)

    # -- the observer -------------------------------------------------------------------------

    def _token_changed(self, robot: str, incarnation: Incarnation, held: bool) -> None:
        self.observer.token(robot, incarnation, held)
        self._observe_soon()

    def _observe_soon(self) -> None:
        if not self._is_observing:
            self._is_observing = True
            self.clock.at(self.clock.now_us, self._observe)

    def _observe(self) -> None:
        self._is_observing = False
        self.observer.update(self.clock.now_us)
        if self.recordings is not None:
            self.recordings.observed(self.clock.now_us)
        if self._look_on is not None:
            self._look_on(self.observer, self.clock.now_us)
        self.ending.look()

    def _observe_regularly(self) -> None:
        self._observe()
        self.inspection.sample()
        if self.inspection.is_settled:
            self.ending.over.set()
        else:
            self.ending.look_whether_stuck(self.clock.now_us)
        self.clock.at(self.clock.now_us + self.timing.heartbeat_us, self._observe_regularly)


# Makes what checks a world: nothing, or the checkers.
Inspect: TypeAlias = Callable[[World], Inspection]
# Is told at which virtual time, in microseconds, the observer has seen what it has.
LookOn: TypeAlias = Callable[[Observer, int], None]
