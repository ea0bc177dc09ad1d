"""One life of a robot in the simulator: what is a process of its own in the real world."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.effects import (
    Ask,
    AskRouter,
    CancelAction,
    DeclareToken,
    Effect,
    Forget,
    Log,
    MakePlan,
    Persist,
    Publish,
    Reply,
    RequestBid,
    StartAction,
    Stop,
)
from mrbt_mesh.core.agent.inputs import ActionFinished, Input, PlanMade, TimerFired
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.recording.robot_recorder import RobotRecorder
from mrbt_mesh.runtime.journal_writer import JournalNews
from mrbt_mesh.sim.world.clock import MICRO, Gate, LocalClock, VirtualClock
from mrbt_mesh.sim.world.journal import Changes, SimJournal, SimJournalWriter
from mrbt_mesh.sim.world.pace import Pace

TIMER_FIRED = TimerFired()


class ProcessListener(Protocol):
    """Is told what processes do."""

    @property
    def watches_steps(self) -> bool: ...

    def booted(self, process: SimProcess) -> None: ...
    def synced(self, process: SimProcess, changes: Changes) -> None: ...
    def handling(self, process: SimProcess, event: Input) -> None: ...
    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None: ...
    def logged(self, robot: str, effect: Effect) -> None: ...


class Environment(Protocol):
    """What a process needs of the world around it."""

    @property
    def clock(self) -> VirtualClock: ...
    @property
    def inspection(self) -> ProcessListener: ...
    @property
    def timing(self) -> Timing: ...
    @property
    def plan_delay_us(self) -> int: ...

    def published(self, process: SimProcess, effect: Publish) -> None: ...
    def asked(self, process: SimProcess, effect: Ask) -> None: ...
    def asked_router(self, process: SimProcess, effect: AskRouter) -> None: ...
    def replied(self, process: SimProcess, effect: Reply) -> None: ...
    def outcome(self, process: SimProcess, event: ActionFinished) -> Input: ...
    def completed(self, process: SimProcess) -> None: ...
    def declared(self, process: SimProcess, incarnation: Incarnation) -> None: ...
    def stopped(self, process: SimProcess) -> None: ...
    def recorded(self, process: SimProcess, event: Mapping[str, Any]) -> None: ...
    def recorder_of(self, process: SimProcess) -> RobotRecorder | None: ...
    def begun_before_us(self, process: SimProcess, effect: StartAction) -> int: ...


class Program(Protocol):
    """What carries out a robot's local tasks."""

    @property
    def runs_by_itself(self) -> bool: ...
    def begin(self) -> None: ...
    def carry_out(self, effect: StartAction | CancelAction | RequestBid) -> None: ...
    def end(self) -> None: ...


class SimProcess:
    """Drives one agent and its program; the simulator's counterpart of the runtime's driver.

    `make_agent` is called at boot with the time on the robot's own clock, `local`. `killed`:
    nothing of it has any effect any more, not even its own records. `stop`: its agent's last
    word.
    """

    def __init__(
        self,
        environment: Environment,
        robot: str,
        journal: SimJournal,
        local: LocalClock,
        make_agent: Callable[[int], Agent],
    ) -> None:
        self.robot = robot
        self.local = local
        self.agent: Agent | None = None
        self.stop: Stop | None = None
        self.killed = False
        self._environment = environment
        self._make_agent = make_agent
        self._program: Program | None = None
        self._pace = Pace(environment.clock, Gate(local), self._handle)
        self._journal = SimJournalWriter(
            journal, environment.clock, self._pace, self._tell, self._synced
        )
        self._ran_us = 0
        self._timer_us: int | None = None
        self._recorder: RobotRecorder | None = None

    @property
    def runs_by_itself(self) -> bool:
        """Whether its program does something that is no local task."""
        return self._program is not None and self._program.runs_by_itself

    @property
    def is_over(self) -> bool:
        """Whether it was killed, or its agent has stopped."""
        return self._pace.is_over

    @property
    def is_slow(self) -> bool:
        return self._pace.is_slow

    @property
    def has_read_journal(self) -> bool:
        """Whether it knows what its journal held when it began."""
        return self._journal.is_read

    @property
    def runs(self) -> bool:
        """Whether it is booted, alive and not frozen, though maybe slow."""
        return self.agent is not None and not self._pace.is_over and not self._pace.is_frozen

    @property
    def gate(self) -> Gate:
        return self._pace.gate

    def boot(self, program: Program) -> None:
        """The agent comes to life, and with it the robot's program."""
        self._program = program
        if self.is_over:
            program.end()
            return
        self._ran_us = self.local.boottime_us
        self.agent = self._make_agent(self._ran_us)
        self._recorder = self._environment.recorder_of(self)
        self._journal.start()
        program.begin()
        self._environment.inspection.booted(self)
        self.deliver(TIMER_FIRED)

    # -- inputs -------------------------------------------------------------------------------

    def deliver(self, event: Input) -> None:
        """Hand an input to the agent; it waits while the process is frozen or slow."""
        if not self._pace.is_held:
            self._handle(event)
        elif self.agent is not None and not self.is_over:
            self._pace.keep(event)

    def _handle(self, event: Input) -> None:
        agent, pace = self.agent, self._pace
        if agent is None or pace.is_over:
            return
        now_us = self.local.boottime_us
        gap_us, self._ran_us = now_us - self._ran_us, now_us
        if gap_us > self._environment.timing.detection_us and not isinstance(event, TimerFired):
            self._handle(TIMER_FIRED)  # as runtime.fencing does
        inspection = self._environment.inspection
        if inspection.watches_steps:
            inspection.handling(self, event)
        effects = agent.handle(event, now_us)
        if self._recorder is not None:
            self._recorder.step(event, effects, self._environment.clock.now_us)
        for effect in effects:
            self._carry_out(effect)
        if inspection.watches_steps:
            inspection.handled(self, event, effects)
        if isinstance(event, ActionFinished):
            self._environment.completed(self)
        if not pace.is_over:
            self._set_timer(agent, now_us)

    def _carry_out(self, effect: Effect) -> None:
        match effect:
            case Publish():
                self._environment.published(self, effect)
            case Persist(entries, at_once, number):
                self._journal.put(entries, number, at_once)
            case Forget(keys):
                self._journal.forget(keys)
            case Ask():
                self._environment.asked(self, effect)
            case AskRouter():
                self._environment.asked_router(self, effect)
            case Reply():
                self._environment.replied(self, effect)
            case MakePlan():
                due_us = self._environment.clock.now_us + self._environment.plan_delay_us
                self._environment.clock.at(due_us, partial(self._make_plan, effect))
            case StartAction() | CancelAction() | RequestBid():
                self._work(effect)
            case DeclareToken(incarnation):
                self._environment.declared(self, incarnation)
            case Stop():
                self.stop = effect
                self._journal.end()
                self._end()
                self._environment.stopped(self)
            case Log():
                pass  # it is in the effect log

    def _work(self, effect: StartAction | CancelAction | RequestBid) -> None:
        assert self._program is not None
        if isinstance(effect, StartAction):
            self.gate.ahead_us = self._environment.begun_before_us(self, effect)
        self._program.carry_out(effect)

    def _make_plan(self, effect: MakePlan) -> None:
        awaited = self.agent.view.awaited_plan if self.agent is not None else None
        if not self.is_over and awaited == effect.number:  # else it was fenced off meanwhile
            self.deliver(PlanMade(effect.number, effect.make()))

    def _set_timer(self, agent: Agent, now_us: int) -> None:
        due_us = agent.next_deadline_us(now_us)
        if self._timer_us is None or due_us < self._timer_us:
            self._timer_us = due_us
            at_us = self.local.when_us(self.local.monotonic_us + due_us - now_us)
            self._environment.clock.at(at_us, lambda: self._timer(due_us))

    def _timer(self, due_us: int) -> None:
        if self._timer_us != due_us:
            return  # an earlier one has replaced it
        self._timer_us = None
        if self.runs:
            self.deliver(TIMER_FIRED)

    def _tell(self, news: JournalNews) -> None:
        """In an event of its own: the journal's thread does not wait for the agent."""
        self._environment.clock.at(self._environment.clock.now_us, partial(self.deliver, news))

    def _synced(self, changes: Changes) -> None:
        self._environment.inspection.synced(self, changes)

    # -- faults -------------------------------------------------------------------------------

    def kill(self) -> None:
        """SIGKILL."""
        self.killed = True
        self._end()

    def freeze(self) -> None:
        """SIGSTOP, or the process' part in a suspend."""
        self._pace.freeze()

    def thaw(self) -> None:
        """SIGCONT."""
        self._pace.thaw()

    def slow(self, lag_us: int) -> None:
        """Come round only every `lag_us` from now on; 0: be fast again after the next time."""
        self._pace.slow(lag_us)

    def _end(self) -> None:
        if self._program is not None:
            self._program.end()
        self._pace.end()

    # -- what its program needs (runtime.actions.Host) ----------------------------------------

    def submit(self, event: Input) -> None:
        clock = self._environment.clock
        if isinstance(event, ActionFinished):
            event = self._environment.outcome(self, event)
        clock.at(clock.now_us, partial(self.deliver, event))

    def read_condition(self, name: str) -> bool:
        view = self.agent.view if self.agent is not None else None
        return view is not None and view.facts.condition_of(view.robot, name)

    def record_event(self, event: Mapping[str, Any]) -> None:
        if not self.killed:
            self._environment.recorded(self, event)

    def unix_time_s(self) -> float:
        return self._environment.clock.now_us / MICRO

    def log(self, level: str, event: str, **fields: Any) -> None:
        if not self.killed:
            self._environment.inspection.logged(self.robot, Log(level, event, fields))
