"""One life of a robot in the simulator: what is a process of its own in the real world."""

from __future__ import annotations

import contextvars
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

import anyio
import anyio.abc

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.effects import (
    Ask,
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
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.runtime.actions import ActionRunner, RobotIdentity
from mrbt_mesh.runtime.inbox import MAX_WAITING
from mrbt_mesh.runtime.journal import LAZY_COMMIT_S
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.engine.clock import MICRO, Gate, LocalClock, VirtualClock, current_gate
from mrbt_mesh.sim.engine.journal import SimJournal

TIMER_FIRED = TimerFired()


class Surroundings(Protocol):
    """What a process needs of its world."""

    clock: VirtualClock

    @property
    def timing(self) -> Timing: ...

    @property
    def inspection(self) -> Witness: ...

    def published(self, process: SimProcess, effect: Publish) -> None: ...
    def asked(self, process: SimProcess, effect: Ask) -> None: ...
    def replied(self, process: SimProcess, effect: Reply) -> None: ...
    def outcome(self, process: SimProcess, event: ActionFinished) -> Input: ...
    def completed(self, process: SimProcess) -> None: ...
    def declared(self, process: SimProcess, incarnation: Incarnation) -> None: ...
    def stopped(self, process: SimProcess) -> None: ...
    def recorded(self, process: SimProcess, event: Mapping[str, Any]) -> None: ...


class Witness(Protocol):
    """Sees what processes do."""

    @property
    def watches_steps(self) -> bool: ...

    def booted(self, process: SimProcess) -> None: ...
    def handling(self, process: SimProcess, event: Input) -> None: ...
    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None: ...
    def logged(self, robot: str, effect: Effect) -> None: ...


class SimProcess:
    """Drives one agent and its program; the simulator's counterpart of the runtime's driver.

    `make_agent` is called at boot with the time on the robot's own clock, `local`. `killed`:
    nothing of it has any effect any more, not even its own records. `is_over`: killed, or its
    agent has stopped.
    """

    def __init__(
        self,
        world: Surroundings,
        identity: RobotIdentity,
        program: RobotProgram,
        journal: SimJournal,
        local: LocalClock,
        make_agent: Callable[[int], Agent],
        plan_delay_us: int = 0,
    ) -> None:
        self.robot = identity.robot
        self.identity = identity
        self.token: Incarnation | None = None
        self.stop: Stop | None = None
        self.agent: Agent | None = None
        self.killed = False
        self.is_over = False
        self.is_frozen = False
        self.journal = journal
        self.local = local
        self._world = world
        self._program = program
        self._make_agent = make_agent
        self._plan_delay_us = plan_delay_us
        # A bounded queue, as the real one: the oldest are lost.
        self._inbox: deque[Input] = deque(maxlen=MAX_WAITING)
        self._gate = Gate(local)
        self._lag_us = 0
        self._awakes = False
        self._commits = False
        self._ran_us = 0
        self._timer_us: int | None = None
        self._scope: anyio.CancelScope | None = None
        self._runner: ActionRunner | None = None
        self._context = contextvars.Context()

    @property
    def is_slow(self) -> bool:
        return self._awakes

    @property
    def runs(self) -> bool:
        """Whether it is booted, alive and not frozen, though maybe slow."""
        return self.agent is not None and not self.is_over and not self.is_frozen

    async def main(self) -> None:
        """Runs as long as the process does."""
        current_gate.set(self._gate)
        async with anyio.create_task_group() as group:
            self._scope = group.cancel_scope
            self._context = contextvars.copy_context()
            clock = self._world.clock
            clock.at(clock.now_us, lambda: self._boot(group))
            await anyio.sleep_forever()

    def _boot(self, group: anyio.abc.TaskGroup) -> None:
        if self.is_over:
            return
        self._ran_us = self.local.boottime_us
        self.agent = agent = self._make_agent(self._ran_us)
        self._runner = ActionRunner(group, self._program, agent.view.mission, self.identity, self)
        self._context.run(self._runner.start_background)
        self._world.inspection.booted(self)
        self.deliver(TIMER_FIRED)

    # -- inputs -------------------------------------------------------------------------------

    def deliver(self, event: Input) -> None:
        """Hand an input to the agent; it waits while the process is frozen or slow."""
        if not (self.is_frozen or self._lag_us):
            self._handle(event)
        elif not self.is_over and self.agent is not None:
            self._inbox.append(event)

    def _handle(self, event: Input) -> None:
        agent, inspection = self.agent, self._world.inspection
        if self.is_over or agent is None:
            return
        now_us = self.local.boottime_us
        gap_us, self._ran_us = now_us - self._ran_us, now_us
        if gap_us > self._world.timing.detection_us and not isinstance(event, TimerFired):
            self._handle(TIMER_FIRED)  # as runtime.fencing does
        if inspection.watches_steps:
            inspection.handling(self, event)
        effects = agent.handle(event, now_us)
        for effect in effects:
            self._carry_out(effect)
        if inspection.watches_steps:
            inspection.handled(self, event, effects)
        if isinstance(event, ActionFinished):
            self._world.completed(self)
        if not self.is_over:
            self._set_timer(agent, now_us)

    def _carry_out(self, effect: Effect) -> None:
        assert self._runner is not None
        match effect:
            case Publish():
                self._world.published(self, effect)
            case Persist(entries, synced):
                self._persist(entries, synced)
            case Forget(keys):
                self.journal.forget(keys)
                self._commit_soon()
            case Ask():
                self._world.asked(self, effect)
            case Reply():
                self._world.replied(self, effect)
            case MakePlan():
                clock = self._world.clock
                clock.at(clock.now_us + self._plan_delay_us, partial(self._make_plan, effect))
            case StartAction() | CancelAction() | RequestBid():
                self._context.run(self._runner.carry_out, effect)
            case DeclareToken(incarnation):
                self._world.declared(self, incarnation)
            case Stop():
                self.stop = effect
                self.is_over = True
                self.journal.commit()
                self._end()
                self._world.stopped(self)
            case Log():
                pass  # it is in the effect log

    def _make_plan(self, effect: MakePlan) -> None:
        awaited = self.agent.view.awaited_plan if self.agent is not None else None
        if not self.is_over and awaited == effect.number:  # else it was fenced off meanwhile
            self.deliver(PlanMade(effect.number, effect.make()))

    def _persist(self, entries: tuple[Entry, ...], synced: bool) -> None:
        self.journal.put(entries)
        if synced:
            self.journal.commit()
        else:
            self._commit_soon()

    def _commit_soon(self) -> None:
        if not self._commits:
            self._commits = True
            self._commit_later()

    def _commit_later(self) -> None:
        clock = self._world.clock
        clock.at(clock.now_us + round(LAZY_COMMIT_S * MICRO), self._commit)

    def _commit(self) -> None:
        if self.is_frozen:
            self._commit_later()
        elif not self.is_over:
            self._commits = False
            self.journal.commit()

    def _set_timer(self, agent: Agent, now_us: int) -> None:
        due_us = agent.next_deadline_us(now_us)
        if self._timer_us is None or due_us < self._timer_us:
            self._timer_us = due_us
            at_us = self.local.when_us(self.local.monotonic_us + due_us - now_us)
            self._world.clock.at(at_us, lambda: self._timer(due_us))

    def _timer(self, due_us: int) -> None:
        if self._timer_us != due_us:
            return  # an earlier one has replaced it
        self._timer_us = None
        if self.runs and self.agent is not None:
            self.deliver(TIMER_FIRED)

    # -- faults -------------------------------------------------------------------------------

    def kill(self) -> None:
        """SIGKILL."""
        self.killed = self.is_over = True
        self.journal.crash()
        self._end()

    def freeze(self) -> None:
        """SIGSTOP, or the process' part in a suspend."""
        self.is_frozen = True
        self._gate.close()

    def thaw(self) -> None:
        """SIGCONT: the agent looks at the clock before anything else of the process goes on."""
        if self.is_frozen:
            self.is_frozen = False
            self._inbox.appendleft(TIMER_FIRED)
            self._catch_up()

    def slow(self, lag_us: int) -> None:
        """Come round only every `lag_us` from now on; 0: be fast again after the next time."""
        self._lag_us = lag_us
        if lag_us and not self._awakes:
            self._awakes = True
            self._gate.close()
            self._wake_later()

    def _wake_later(self) -> None:
        clock = self._world.clock
        clock.at(clock.now_us + self._lag_us, self._wake)

    def _wake(self) -> None:
        if self.is_over:
            return
        self._awakes = bool(self._lag_us)
        if not self.is_frozen:
            self._catch_up()
        if self._awakes:
            self._wake_later()

    def _catch_up(self) -> None:
        """Handle what has waited, then let the program's timers go on."""
        waiting = list(self._inbox)
        self._inbox.clear()
        for event in waiting:
            self._handle(event)
        self._gate.open()
        if self._awakes and not self.is_over:
            self._gate.close()

    def _end(self) -> None:
        if self._scope is not None:
            self._scope.cancel()
        self._gate.open()

    # -- what its program needs (runtime.actions.Host) ----------------------------------------

    def submit(self, event: Input) -> None:
        clock = self._world.clock
        if isinstance(event, ActionFinished):
            event = self._world.outcome(self, event)
        clock.at(clock.now_us, partial(self.deliver, event))

    def read_condition(self, name: str) -> bool:
        return self.agent is not None and self.agent.view.facts.condition(name)

    def record_event(self, event: Mapping[str, Any]) -> None:
        if not self.killed:
            self._world.recorded(self, event)

    def unix_time_s(self) -> float:
        return self._world.clock.now_us / MICRO

    def log(self, level: str, event: str, **fields: Any) -> None:
        if not self.killed:
            self._world.inspection.logged(self.robot, Log(level, event, fields))
