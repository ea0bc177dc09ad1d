"""A robot's program in the simulator: real async code, on the event loop in virtual time."""

from __future__ import annotations

import asyncio
import contextvars
from functools import partial
from typing import Protocol

import anyio
import anyio.abc

from mrbt_mesh.core.agent.effects import CancelAction, RequestBid, StartAction
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.runtime.actions import ActionRunner, RobotIdentity
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.task_port import Host
from mrbt_mesh.sim.world.clock import Gate, VirtualClock, current_gate
from mrbt_mesh.sim.world.process import Program

# So long code of a program may go on after its process has ended.
END_LIMIT_S = 3.0


class Bootable(Host, Protocol):
    """A process as its program sees it."""

    @property
    def gate(self) -> Gate: ...
    def boot(self, program: Program) -> None: ...


class ProgramTasks:
    """The tasks of one process; their timers wait while its gate is closed."""

    def __init__(
        self,
        group: anyio.abc.TaskGroup,
        program: RobotProgram,
        mission: Mission,
        identity: RobotIdentity,
        host: Host,
    ) -> None:
        self._scope = group.cancel_scope
        self._runner = ActionRunner(group, program, mission, identity, host)
        self._context = contextvars.copy_context()

    def begin(self) -> None:
        """What the program does by itself, from the start of the process on."""
        self._context.run(self._runner.start_background)

    @property
    def runs_by_itself(self) -> bool:
        """Whether something of the program goes on that is no local task."""
        return self._runner.backgrounds > 0

    def carry_out(self, effect: StartAction | CancelAction | RequestBid) -> None:
        """Start or cancel an action, or ask for a bid."""
        self._context.run(self._runner.carry_out, effect)

    def end(self) -> None:
        """Cancel all of it."""
        self._scope.cancel()

    def abandon(self) -> None:
        """End what goes on although it is cancelled."""
        self._runner.abandon()


async def run_program(
    process: Bootable,
    program: RobotProgram,
    mission: Mission,
    identity: RobotIdentity,
    clock: VirtualClock,
) -> None:
    """Boot a process with its program, which goes on until it is cancelled."""
    current_gate.set(process.gate)
    async with anyio.create_task_group() as group:
        tasks = ProgramTasks(group, program, mission, identity, process)
        clock.at(clock.now_us, partial(process.boot, tasks))
        try:
            await anyio.sleep_forever()
        finally:
            # Apart from the robot's clock, which may stand still.
            loop = asyncio.get_running_loop()
            contextvars.Context().run(loop.call_later, END_LIMIT_S, tasks.abandon)
