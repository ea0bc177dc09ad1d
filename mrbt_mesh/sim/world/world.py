"""The simulated world: robots' processes, what is between them, faults, an observer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import anyio

from mrbt_mesh.core.agent.effects import FeatureEffect, Publish, StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished, FeatureInput
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Claim, Phase, TeamOrder
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.envelope import Guard
from mrbt_mesh.core.mission.mission import Mission, MissionEnd
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.robot_recorder import RobotRecorder
from mrbt_mesh.sim.world.client import Client
from mrbt_mesh.sim.world.clock import VirtualClock
from mrbt_mesh.sim.world.driving import Driving
from mrbt_mesh.sim.world.failures import RandomFailures
from mrbt_mesh.sim.world.injector import Injector
from mrbt_mesh.sim.world.message_bus import MessageBus
from mrbt_mesh.sim.world.network import Network, Routers
from mrbt_mesh.sim.world.process import Inspection, SimProcess
from mrbt_mesh.sim.world.recordings import Recordings
from mrbt_mesh.sim.world.robots import Robots
from mrbt_mesh.sim.world.setup import Place, RecordedWork, Setup

# How long, in detection times, robots that were cut off may outlive the end of the mission.
GIVE_UP_DETECTIONS = 5


class World:
    """Everything that is there, and what happens when. One instance is one run.

    `inspect` makes what checks it. `look_on` is called with the observer and the virtual time in
    microseconds whenever the observer has been brought up to date. `events`: what the robots have
    recorded themselves. `over`: the run has ended; `timed_out`: at its timeout; `gave_up`: robots
    outlived the end of the mission; `error`: what broke.
    """

    def __init__(self, setup: Setup, inspect: Inspect, look_on: LookOn | None = None) -> None:
        self.setup = setup
        self.mission = setup.mission
        self.timing = setup.timing
        self.plan_delay_us = setup.agents.plan_delay_us or 0
        self.speed = setup.speed
        self.solver = default_solver
        self._look_on = look_on
        self.clock = VirtualClock()
        self.network = Network(setup.network, setup.seed)
        routers = Routers(setup.network.routers, setup.seed)
        self.bus = MessageBus(self.clock, self.network, routers, self._token_changed)
        self.robots = Robots(self)
        keys = setup.agents.keys.get("")
        self._guard = Guard(keys, setup.run, 1) if keys is not None else None
        self.observer = Observer(
            setup.mission, setup.run, self.timing, default_solver, setup.agents.engine, keys
        )
        self.events: list[dict[str, Any]] = []
        self._works: dict[Place, list[RecordedWork]] = {}
        if setup.begin is not None:
            self._works = {place: list(works) for place, works in setup.begin.works.items()}
            self.observer.read(setup.begin.facts, self.clock.now_us)
        self.recordings: Recordings | None = None
        if setup.record is not None:
            self.recordings = Recordings(setup, setup.record, self.observer)
        self._is_observing = False
        self.inspection = inspect(self)
        self.client = Client(setup, self.bus, self.robots, self.observer)
        self.injector = Injector(
            setup, self.bus, self.robots, self.inspection, self.client, self._has_result
        )
        self.driving = Driving(setup)
        self.failures = RandomFailures(setup, self.clock, self.robots, self.injector.inject)
        self.over = anyio.Event()
        self.timed_out = False
        self.gave_up = False
        self.error: Exception | None = None
        # The number of changes of the facts, and since when it is the same.
        self._stuck_since: tuple[int, int] = (0, 0)

    async def main(self) -> None:
        """Run until the mission is over, nothing can happen any more, or the timeout."""
        self.clock.on_error = self._fail
        async with anyio.create_task_group() as group:
            self.robots.launch_all(lambda process: group.start_soon(process.run))
            self.injector.begin()
            self.clock.at(self.setup.timeout_us, self._time_out)
            self.clock.at(0, self._observe_regularly)
            await self.over.wait()
            group.cancel_scope.cancel()
        if self.error is not None:
            raise self.error

    # -- what checkers see --------------------------------------------------------------------

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

    # -- what processes do (robots.TeamSurroundings) ------------------------------------------

    def launched(self, process: SimProcess) -> None:
        self.failures.launched(process)

    def revised(self, mission: Mission) -> None:
        """A robot has taken up a revision of the mission."""
        if mission.number > self.mission.number:
            self.mission = mission
            self.driving.revised(mission)

    def killed(self, process: SimProcess) -> None:
        self.observer.record.exited(process.robot, self.clock.now_us)

    def published(self, process: SimProcess, effect: Publish) -> None:
        message = self.bus.publish(process.robot, effect)
        self.injector.heard(message)
        data = effect.data
        if self._guard is not None:
            _, data = self._guard.open(data, effect.kind, process.robot)
        self.observer.message(effect.kind, process.robot, data, self.clock.now_us)
        self._observe_soon()

    def stopped(self, process: SimProcess) -> None:
        plan = process.agent.view.plan if process.agent else None
        stands_by = (
            self.mission.ends is MissionEnd.NEVER and plan and plan.command is not TeamOrder.ABORT
        )
        if plan and not stands_by and plan.result in (Status.SUCCESS, Status.FAILURE):
            # It has seen the whole team agree. Robots that it could not reach may never learn it.
            now_us = self.clock.now_us
            self.observer.record.over(plan.result, now_us)
            self.clock.at(now_us + GIVE_UP_DETECTIONS * self.timing.detection_us, self._give_up)
        self.bus.withdraw(process.robot)

    def outcome(self, process: SimProcess, event: ActionFinished) -> ActionFinished:
        return self.failures.outcome(process, event)

    def completed(self, process: SimProcess) -> None:
        self.robots.completed(process.robot)
        self.failures.completed(process)

    def recorder_of(self, process: SimProcess) -> RobotRecorder | None:
        if self.recordings is None or process.agent is None:
            return None
        return self.recordings.begin(process.agent.view, self.clock.now_us)

    def recorded_work(self, process: SimProcess, effect: StartAction) -> RecordedWork | None:
        works = self._works.get((process.robot, effect.activation, effect.local_task))
        return works.pop(0) if works else None

    def recorded_way_us(self, process: SimProcess) -> int:
        """For how long a robot whose life goes on has been on its way already."""
        view, begin = process.agent.view if process.agent else None, self.setup.begin
        life = begin.lives.get(process.robot) if begin is not None else None
        if begin is None or view is None or life is None:
            return 0
        if view.incarnation != life.version.incarnation:
            return 0
        known = [entry.record for entry in begin.facts if entry.author == view.robot]
        is_on = any(isinstance(r, Claim) and r.phase is Phase.TRAVELLING for r in known)
        return begin.ways_us.get(view.robot, 0) if is_on else 0

    def recorded_answer(self, process: SimProcess, effect: FeatureEffect) -> FeatureInput | None:
        begin = self.setup.begin
        return begin.answer(process.robot, effect) if begin is not None else None

    # -- the observer -------------------------------------------------------------------------

    def _token_changed(self, robot: str, incarnation: Incarnation, held: bool) -> None:
        self.observer.membership.receive_token(robot, incarnation, held)
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
        if self._nothing_left():
            self.over.set()

    def _observe_regularly(self) -> None:
        self._observe()
        self.inspection.sample()
        if self.inspection.is_settled or (self.setup.stop_when_stuck and self._is_stuck()):
            self.over.set()
        self.clock.at(self.clock.now_us + self.timing.heartbeat_us, self._observe_regularly)

    # -- the end ------------------------------------------------------------------------------

    def _time_out(self) -> None:
        self.timed_out = True
        self.over.set()

    def _give_up(self) -> None:
        self.gave_up = True
        self.over.set()

    def _fail(self, error: Exception) -> None:
        self.error = error
        self.over.set()

    def _has_result(self) -> bool:
        return self.observer.record.result is not None

    def _is_awaiting(self) -> bool:
        """Whether something is still to come that could help the team."""
        return bool(self.injector.pending or self.failures.awaited)

    def _nothing_left(self) -> bool:
        if self.robots.to_launch:
            return False  # they are still being launched
        if self.setup.until_jobs_end and not self._is_awaiting() and self.client.jobs_have_ended():
            return True
        if self._has_result():
            return not self.living()
        return not self._is_awaiting() and all(p.is_over for p in self.robots.processes.values())

    def _is_stuck(self) -> bool:
        """Whether nothing more will happen: for as long as it may take to declare a robot dead,
        nobody has worked or had anything to do, no deadline ran, and no fact has changed.
        """
        now_us, changes = self.clock.now_us, self.observer.facts.changes
        if self._is_awaiting() or not all(map(_rests, self.living())):
            changes = -1
        if changes != self._stuck_since[0]:
            self._stuck_since = (changes, now_us)
        patience_us = self.timing.max_detection_us + self.timing.detection_us
        return changes >= 0 and self._stuck_since[1] + patience_us <= now_us


def _rests(process: SimProcess) -> bool:
    agent = process.agent.view if process.agent else None
    return not process.runs_by_itself and (
        agent is None
        or (
            not agent.is_joining
            and agent.plan is not None
            and not agent.plan.assignments
            and agent.action is None
            and not agent.waits_for_deadline
        )
    )


# Makes what checks a world: nothing, or the checkers.
Inspect: TypeAlias = Callable[[World], Inspection]
LookOn: TypeAlias = Callable[[Observer, int], None]
