"""One life of a robot in the simulator: what is a process of its own in the real world."""

from __future__ import annotations

import contextvars
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import anyio
import anyio.abc

from mrbt_mesh.core.agent import Agent
from mrbt_mesh.core.effects import (
    Ask,
    CancelAction,
    DeclareToken,
    Effect,
    Input,
    Log,
    Persist,
    Publish,
    Reply,
    StartAction,
    Stop,
    TimerFired,
)
from mrbt_mesh.core.facts import Entry, Incarnation
from mrbt_mesh.runtime.actions import ActionRunner, Identity
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.clock import MICRO, Gate, VirtualClock, current_gate
from mrbt_mesh.sim.effect_log import EffectLog

MAX_INBOX = 1_000


class Surroundings(Protocol):
    """What a process needs of its world."""

    clock: VirtualClock
    log: EffectLog

    def published(self, process: SimProcess, effect: Publish) -> None: ...
    def asked(self, process: SimProcess, effect: Ask) -> None: ...
    def replied(self, process: SimProcess, effect: Reply) -> None: ...
    def persisted(self, process: SimProcess, entries: tuple[Entry, ...]) -> None: ...
    def declared(self, process: SimProcess, incarnation: Incarnation) -> None: ...
    def stopped(self, process: SimProcess) -> None: ...
    def recorded(self, process: SimProcess, event: Mapping[str, Any]) -> None: ...
    def handled(self, process: SimProcess, event: Input, effects: list[Effect]) -> None: ...


class SimProcess:
    """Drives one agent and its program; the simulator's counterpart of the runtime's driver.

    `make_agent` is called at boot with the time. `killed`: nothing of it has any effect any more,
    not even its own records. `is_over`: killed, or its agent has stopped.
    """

    def __init__(
        self,
        world: Surroundings,
        identity: Identity,
        program: RobotProgram,
        make_agent: Callable[[int], Agent],
    ) -> None:
        self.robot = identity.robot
        self.identity = identity
        self.token: Incarnation | None = None
        self.stop: Stop | None = None
        self.agent: Agent | None = None
        self.killed = False
        self.is_frozen = False
        self._world = world
        self._program = program
        self._make_agent = make_agent
        self._inbox: list[Input] = []
        self._gate = Gate()
        self._timer_us: int | None = None
        self._scope: anyio.CancelScope | None = None
        self._runner: ActionRunner | None = None
        self._context = contextvars.Context()

    @property
    def is_over(self) -> bool:
        return self.killed or self.stop is not None

    @property
    def runs(self) -> bool:
        """Whether it is booted, alive and not frozen."""
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
        self.agent = agent = self._make_agent(self._world.clock.now_us)
        self._runner = ActionRunner(group, self._program, agent.mission, self.identity, self)
        self._context.run(self._runner.start_background)
        self.deliver(TimerFired())

    # -- inputs -------------------------------------------------------------------------------

    def deliver(self, event: Input) -> None:
        """Hand an input to the agent; it waits while the process is frozen."""
        if self.is_over or self.agent is None:
            return
        if self.is_frozen:
            # A bounded queue, as the real one: what does not fit any more is lost.
            if len(self._inbox) < MAX_INBOX:
                self._inbox.append(event)
            return
        effects = self.agent.handle(event, self._world.clock.now_us)
        for effect in effects:
            self._world.log.write(self._world.clock.now_us, self.robot, effect)
            self._carry_out(effect)
        self._world.handled(self, event, effects)
        self._set_timer()

    def _carry_out(self, effect: Effect) -> None:
        assert self._runner is not None
        match effect:
            case Publish():
                self._world.published(self, effect)
            case Persist(entries):
                self._world.persisted(self, entries)
            case Ask():
                self._world.asked(self, effect)
            case Reply():
                self._world.replied(self, effect)
            case StartAction():
                self._context.run(self._runner.start, effect)
            case CancelAction(ticket):
                self._runner.cancel(ticket)
            case DeclareToken(incarnation):
                self._world.declared(self, incarnation)
            case Stop():
                self.stop = effect
                self._end()
                self._world.stopped(self)
            case Log():
                pass  # it is in the effect log

    def _set_timer(self) -> None:
        if self.agent is None or self.is_over:
            return
        clock = self._world.clock
        due_us = self.agent.next_deadline_us(clock.now_us)
        if self._timer_us is None or due_us < self._timer_us:
            self._timer_us = due_us
            clock.at(due_us, lambda: self._timer(due_us))

    def _timer(self, due_us: int) -> None:
        if self._timer_us != due_us:
            return  # an earlier one has replaced it
        self._timer_us = None
        if self.runs and self.agent is not None:
            self.deliver(TimerFired())

    # -- faults -------------------------------------------------------------------------------

    def kill(self) -> None:
        """SIGKILL."""
        self.killed = True
        self._end()

    def freeze(self) -> None:
        """SIGSTOP."""
        self.is_frozen = True
        self._gate.close()

    def thaw(self) -> None:
        """SIGCONT: the agent looks at the clock before anything else of the process goes on."""
        if not self.is_frozen:
            return
        self.is_frozen = False
        waiting, self._inbox = self._inbox, []
        for event in (TimerFired(), *waiting):
            self.deliver(event)
        self._gate.open()

    def _end(self) -> None:
        if self._scope is not None:
            self._scope.cancel()
        self._gate.open()

    # -- what its program needs (runtime.actions.Host) ----------------------------------------

    def submit(self, event: Input) -> None:
        clock = self._world.clock
        clock.at(clock.now_us, lambda: self.deliver(event))

    def read_condition(self, name: str) -> bool:
        return self.agent is not None and self.agent.facts.condition(name)

    def record_event(self, event: Mapping[str, Any]) -> None:
        if not self.killed:
            self._world.recorded(self, event)

    def unix_time_s(self) -> float:
        return self._world.clock.now_us / MICRO

    def log(self, level: str, event: str, **fields: Any) -> None:
        if not self.killed:
            self._world.log.write(self._world.clock.now_us, self.robot, Log(level, event, fields))
