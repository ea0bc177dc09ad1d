"""One life of a robot in the simulator: what is a process of its own in the real world."""

from __future__ import annotations

import asyncio
import contextvars
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

import anyio

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.effects import (
    Ask,
    AskRouter,
    CancelAction,
    DeclareToken,
    Effect,
    FeatureEffect,
    Forget,
    Log,
    MakePlan,
    Persist,
    Publish,
    Reply,
    SearchSchedule,
    StartAction,
    Stop,
    UseMission,
)
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    ActionStopped,
    ConditionSet,
    FeatureInput,
    Input,
    PlanMade,
    RecordingSigned,
    ScheduleFound,
    TimerFired,
    WallClockRead,
)
from mrbt_mesh.core.agent.wall_clock import READ_AGAIN_US
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.recording.robot_recorder import RobotRecorder
from mrbt_mesh.runtime.actions import ActionRunner, ProgramEffect, RobotIdentity
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.sim.world.clock import MICRO, Gate, LocalClock, VirtualClock, current_gate
from mrbt_mesh.sim.world.driving import Driving
from mrbt_mesh.sim.world.faults import Fault
from mrbt_mesh.sim.world.journal import Changes, SimJournal, SimJournalWriter
from mrbt_mesh.sim.world.message_bus import MessageBus
from mrbt_mesh.sim.world.pace import Pace
from mrbt_mesh.sim.world.setup import RecordedWork, Setup

TIMER_FIRED = TimerFired()
# How long a program's code may go on after its process has ended.
END_LIMIT_S = 3.0
# How long robots of a recorded run may have waited for agreement before they started.
MOST_WAITED_US = 500_000
# How long a robot searches a schedule.
SEARCH_US = 300_000


class Surroundings(Protocol):
    """The world, as far as a process has to do with it."""

    setup: Setup
    mission: Mission
    clock: VirtualClock
    bus: MessageBus
    inspection: Inspection
    driving: Driving
    events: list[dict[str, Any]]

    def published(self, process: SimProcess, effect: Publish) -> None: ...
    def outcome(self, process: SimProcess, event: ActionFinished) -> Input: ...
    def completed(self, process: SimProcess) -> None: ...
    def stopped(self, process: SimProcess) -> None: ...
    def revised(self, mission: Mission) -> None: ...
    def recorder_of(self, process: SimProcess) -> RobotRecorder | None: ...
    def recorded_work(self, process: SimProcess, effect: StartAction) -> RecordedWork | None: ...
    def recorded_way_us(self, process: SimProcess) -> int: ...
    def recorded_answer(
        self, process: SimProcess, effect: FeatureEffect
    ) -> FeatureInput | None: ...


class Inspection:
    """Called at the moments of a run that may be checked; this one checks nothing.

    It has no influence on the run. `violations` are the invariants that did not hold, `checks`
    counts checks per invariant. `is_settled`: nothing more will come of the run. `done_twice`
    counts local tasks that succeeded more often than their `max`, `exclusive_done_twice` exclusive
    tasks that did.
    """

    def __init__(self) -> None:
        self.violations: Sequence[str] = ()
        self.checks: Mapping[str, int] = {}
        self.effect_log: Sequence[str] = ()
        self.effect_log_digest = ""
        self.is_settled = False
        self.done_twice = self.exclusive_done_twice = 0

    def lost_journal(self, robot: str) -> None:
        """A robot is launched with an empty journal."""

    def booted(self, process: SimProcess) -> None:
        """A process has read its journal and has an agent."""

    def synced(self, process: SimProcess, changes: Changes) -> None:
        """A process has put this on its disk."""

    def handling(self, process: SimProcess, event: Input) -> None:
        """Before a step of an agent."""

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        """After a step of an agent; its effects have been carried out."""

    def logged(self, robot: str, effect: Effect) -> None:
        """A robot's program, or what runs it, has written to the log."""

    def fault_comes(self, fault: Fault) -> None:
        """A fault is about to happen."""

    def garbage(self, process: SimProcess, event: Input) -> None:
        """Something malformed, foreign or forged arrives."""
        process.deliver(event)

    def sample(self) -> None:
        """Called once per heartbeat period."""

    def ended(self, outlived: bool, timed_out: bool) -> None:
        """The run has ended: some robots still run long after the mission; without a result."""


class SimProcess:
    """Drives one agent and its program; the simulator's counterpart of the runtime's driver.

    `make_agent` is called at boot with the time on the robot's own clock, `local`. `killed`:
    nothing of it has any effect any more, not even its own records. `stop`: why its agent stopped.
    `pace`: when it runs.
    """

    def __init__(
        self,
        world: Surroundings,
        mission: Mission,
        identity: RobotIdentity,
        journal: SimJournal,
        local: LocalClock,
        make_agent: Callable[[int], Agent],
    ) -> None:
        self.robot = identity.robot
        self.local = local
        self.agent: Agent | None = None
        self.stop: Stop | None = None
        self.killed = False
        self._world = world
        self._clock = world.clock
        self._mission = mission
        self._identity = identity
        self._make_agent = make_agent
        self.pace = Pace(self._clock, Gate(local), self._handle)
        self._journal = SimJournalWriter(
            journal,
            self._clock,
            self.pace,
            # In an event of its own: the journal's thread does not wait for the agent.
            lambda news: self._clock.at(self._clock.now_us, partial(self.deliver, news)),
            lambda changes: world.inspection.synced(self, changes),
        )
        self._runner: ActionRunner | None = None
        self._end_program: Callable[[], object] = lambda: None
        self._context = contextvars.copy_context()
        self._ran_us = 0
        self._timer_us: int | None = None
        self._recorder: RobotRecorder | None = None
        # What the robot's wall clock shows more than its boot-time clock, as the agent knows it.
        self._wall_clock_offset_us: int | None = None
        # The action that goes as it went in a recording.
        self._repeated: int | None = None

    @property
    def runs_by_itself(self) -> bool:
        """Whether its program does something that is no local task."""
        return self._runner is not None and self._runner.backgrounds > 0

    @property
    def is_over(self) -> bool:
        """Whether it was killed, or its agent has stopped."""
        return self.pace.is_over

    @property
    def is_slow(self) -> bool:
        return self.pace.is_slow

    @property
    def has_read_journal(self) -> bool:
        """Whether it knows what its journal held when it began."""
        return self._journal.is_read

    @property
    def runs(self) -> bool:
        """Whether it is booted, alive and not frozen, though maybe slow."""
        return self.agent is not None and not self.pace.is_over and not self.pace.is_frozen

    # -- beginning and end --------------------------------------------------------------------

    async def run(self) -> None:
        """Boot, and run the robot's program until the process ends: real code, virtual time."""
        current_gate.set(self.pace.gate)
        setup = self._world.setup
        async with anyio.create_task_group() as group:
            driving = self._world.driving
            runner = ActionRunner(
                group,
                setup.program,
                self._mission,
                self._identity,
                self,
                drive=self._drive,
                stretch=partial(driving.stretch, self.robot),
            )
            boot = partial(self.boot, runner, contextvars.copy_context(), group.cancel_scope.cancel)
            self._clock.at(self._clock.now_us, boot)
            try:
                await anyio.sleep_forever()
            finally:
                # By the simulation's clock: the robot's may be stopped.
                loop = asyncio.get_running_loop()
                contextvars.Context().run(loop.call_later, END_LIMIT_S, runner.abandon)

    async def _drive(self, task: TaskContext, place: str) -> None:
        assert self.agent is not None
        table = self.agent.view.facts.travel_table(self.robot)
        await self._world.driving.drive(task, place, table)

    def boot(
        self, runner: ActionRunner, context: contextvars.Context, end: Callable[[], object]
    ) -> None:
        """The agent comes to life, and its program's runner with it, until `end` is called."""
        self._runner, self._context, self._end_program = runner, context, end
        if self.is_over:
            end()
            return
        self._ran_us = self.local.boottime_us
        self.agent = self._make_agent(self._ran_us)
        self._recorder = self._world.recorder_of(self)
        self._journal.start()
        context.run(runner.start_background)
        self._world.inspection.booted(self)
        self.deliver(TIMER_FIRED)

    def suspend(self) -> None:
        """Its computer sleeps."""
        self.local.suspend()
        self.pace.freeze()

    def pause(self) -> None:
        """Its machine is paused."""
        self.local.suspend(is_paused=True)
        self.pace.freeze()

    def thaw(self) -> None:
        """It goes on after a freeze, a suspend or a pause."""
        self.local.resume()
        self.pace.thaw()

    def kill(self) -> None:
        """SIGKILL."""
        self.killed = True
        if self._recorder is not None:
            self._recorder.abandon()
        self._end()

    def _end(self) -> None:
        self._end_program()
        self.pace.end()

    # -- inputs and effects -------------------------------------------------------------------

    def deliver(self, event: Input) -> None:
        """Hand an input to the agent; it waits while the process is frozen or slow."""
        if not self.pace.is_held:
            self._handle(event)
        elif self.agent is not None and not self.is_over:
            self.pace.keep(event)

    def _handle(self, event: Input) -> None:
        agent, world = self.agent, self._world
        if agent is None or self.pace.is_over:
            return
        now_us = self.local.boottime_us
        gap_us, self._ran_us = now_us - self._ran_us, now_us
        if gap_us > world.setup.timing.detection_us and not isinstance(event, TimerFired):
            self._handle(TIMER_FIRED)  # as runtime.fencing does
        if agent.view.reads_wall_clock:
            self._read_wall_clock(now_us)
        inspection = world.inspection
        inspection.handling(self, event)
        effects = agent.handle(event, now_us)
        if self._recorder is not None:
            self._recorder.step(event, effects, self._clock.now_us)
        for effect in effects:
            self._carry_out(effect)
        inspection.handled(self, event, effects)
        if self._runner is not None:
            self._runner.gate.look()
        if isinstance(event, ActionFinished):
            world.completed(self)
        head = self._recorder.take_head() if self._recorder is not None else None
        if head is not None:
            self._handle(RecordingSigned(head))
        if not self.pace.is_over:
            self._set_timer(agent, now_us)

    def _read_wall_clock(self, now_us: int) -> None:
        """As runtime.driver does."""
        offset_us, before_us = self.local.unix_us - now_us, self._wall_clock_offset_us
        if before_us is None or abs(offset_us - before_us) >= READ_AGAIN_US:
            self._wall_clock_offset_us = offset_us
            self._handle(WallClockRead(offset_us))

    def _carry_out(self, effect: Effect) -> None:
        world = self._world
        match effect:
            case Publish():
                world.published(self, effect)
            case Persist() | Forget():
                self._journal.carry_out(effect)
            case Ask():
                world.bus.ask(self, effect)
            case AskRouter():
                world.bus.ask_router(self, effect)
            case Reply():
                world.bus.reply(self.robot, effect)
            case MakePlan():
                due_us = self._clock.now_us + (world.setup.agents.plan_delay_us or 0)
                self._clock.at(due_us, partial(self._make_plan, effect))
            case SearchSchedule():
                self._clock.at(self._clock.now_us + SEARCH_US, partial(self._search, effect))
            case StartAction() | CancelAction() | FeatureEffect() | UseMission():
                self._work(effect)
            case DeclareToken(incarnation):
                world.bus.declare(self.robot, incarnation)
            case Stop():
                self.stop = effect
                self._journal.end()
                self._end()
                world.stopped(self)
            case Log():
                pass  # it is in the effect log

    def _work(self, effect: ProgramEffect) -> None:
        assert self._runner is not None
        now_us = self._clock.now_us
        match effect:
            case UseMission(mission):
                self._world.revised(mission)
            case StartAction() if effect.travel_to and effect.ticket == 1:
                self.pace.gate.ahead_us = self._world.recorded_way_us(self)
            case StartAction(ticket) if not effect.travel_to:
                work = self._world.recorded_work(self, effect)
                if work is not None:
                    self._repeated = ticket
                    # It has lost no time here between its plan and its start.
                    waited_us = work.starts_us - now_us
                    waited_us = waited_us if 0 < waited_us < MOST_WAITED_US else 0
                    for after_us, event in work.events:
                        ahead_us = work.begun_us + after_us
                        step = partial(self._repeat, effect, ahead_us, event)
                        self._clock.at(now_us + waited_us + after_us, step)
                    return
            case CancelAction(ticket) if ticket == self._repeated:
                self._repeated = None
                self.submit(ActionStopped(ticket))
                return
            case FeatureEffect():
                answer = self._world.recorded_answer(self, effect)
                if answer is not None:
                    self.submit(answer)
                    return
        self._context.run(self._runner.carry_out, effect)

    def _repeat(
        self, start: StartAction, ahead_us: int, event: ConditionSet | ActionFinished | None
    ) -> None:
        """A recorded run of a local task goes on, unless it was cancelled."""
        if self._repeated != start.ticket or self.is_over:
            return
        if isinstance(event, ConditionSet):
            self.deliver(event)
            return
        self._repeated = None
        if event is not None:
            self.deliver(replace(event, ticket=start.ticket))
        elif self._runner is not None:
            self.pace.gate.ahead_us = ahead_us
            self._context.run(self._runner.carry_out, start)

    def _make_plan(self, effect: MakePlan) -> None:
        awaited = self.agent.view.awaited_plan if self.agent is not None else None
        if not self.is_over and awaited == effect.number:  # else it was fenced off meanwhile
            self.deliver(PlanMade(effect.number, effect.make()))

    def _search(self, effect: SearchSchedule) -> None:
        if not self.is_over:
            *_, best = effect.steps
            self.deliver(ScheduleFound(effect.number, best.schedule))

    def _set_timer(self, agent: Agent, now_us: int) -> None:
        due_us = agent.next_deadline_us(now_us)
        if self._timer_us is None or due_us < self._timer_us:
            self._timer_us = due_us
            at_us = self.local.when_us(self.local.monotonic_us + due_us - now_us)
            self._clock.at(at_us, lambda: self._timer(due_us))

    def _timer(self, due_us: int) -> None:
        if self._timer_us != due_us:
            return  # an earlier one has replaced it
        self._timer_us = None
        if self.runs:
            self.deliver(TIMER_FIRED)

    # -- what its program needs (runtime.task_port.Host) --------------------------------------

    def submit(self, event: Input) -> None:
        if isinstance(event, ActionFinished):
            event = self._world.outcome(self, event)
        self._clock.at(self._clock.now_us, partial(self.deliver, event))

    def take_news(self) -> None:
        pass  # it is taken in when it arrives

    def may_step(self) -> bool:
        if self.agent is None:
            return True
        until_us = self.agent.view.stepping.until_us()
        return until_us is None or self.local.boottime_us < until_us

    def read_condition(self, name: str) -> bool:
        view = self.agent.view if self.agent is not None else None
        return view is not None and view.facts.condition_of(view.robot, name)

    def read_value(self, name: str, job: str) -> Value | None:
        view = self.agent.view if self.agent is not None else None
        return None if view is None else view.facts.entry(view.robot, name, job)

    def record_event(self, event: Mapping[str, Any]) -> None:
        if not self.killed:
            self._world.events.append(dict(event))

    def unix_time_s(self) -> float:
        return self._clock.now_us / MICRO

    def log(self, level: str, event: str, **fields: Any) -> None:
        if not self.killed:
            self._world.inspection.logged(self.robot, Log(level, event, fields))
