"""Fault injection: what each fault of a schedule does to the simulated world."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mrbt_mesh.core.agent.commands import ORDER, command_body
from mrbt_mesh.core.agent.inputs import (
    CapabilityChanged,
    Input,
    LeaveRequested,
    MessageReceived,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.facts.records import OrderKind
from mrbt_mesh.core.membership.wire import Header, MessageKind, encode
from mrbt_mesh.sim.engine import faults
from mrbt_mesh.sim.engine.garbage import Forger
from mrbt_mesh.sim.engine.process import SimProcess

if TYPE_CHECKING:
    from mrbt_mesh.sim.engine.world import World

# Faults that may leave a robot alone with what it believes for a while.
_ISOLATING = (
    faults.Block
    | faults.Freeze
    | faults.Suspend
    | faults.Restart
    | faults.Slow
    | faults.ClockJump
    | faults.Disturb
    | faults.Replay
    | faults.LoseToken  # a suspect is left out when agreement is counted
)
# What a robot lacks from the beginning it finds out once it has started.
_OF_THE_ROBOT = faults.Lose | faults.Restore
BOOT_US = 1_000


class Injector:
    """Carries out faults. `cut_off`: some robot could not hear all others in time for a while."""

    def __init__(self, world: World, header: Header) -> None:
        self.cut_off = False
        self._world = world
        self._header = header
        self._forger = Forger(world.setup.seed, header)
        self._spoken: dict[str, list[tuple[int, MessageReceived]]] = {}
        self._listens = any(isinstance(f, faults.Replay) for _, f in world.setup.schedule)

    def heard(self, source: str, message: MessageReceived) -> None:
        """A robot has published something; it may be replayed later."""
        if self._listens:
            spoken = self._spoken.setdefault(source, [])
            spoken.append((self._world.clock.now_us, message))

    def inject(self, fault: faults.Fault) -> None:
        """Let one fault befall the team now."""
        world = self._world
        self.cut_off |= isinstance(fault, _ISOLATING)
        self.cut_off |= isinstance(fault, faults.Heal) and bool(fault.broken)
        match fault:
            case faults.Kill() | faults.KillAfter() | faults.Restart():
                self._end(fault)
            case faults.Block(links):
                world.network.block(links)
            case faults.Unblock(links):
                world.network.unblock(links)
            case faults.Disturb(link, links):
                world.network.disturb(link, links)
            case faults.Settle(links):
                world.network.settle(links)
            case faults.Heal(robots, broken):
                self._heal(robots)
                world.network.block(broken)
            case faults.ClockRate(robot, rate_ppm):
                world.local_clock(robot).set_rate(rate_ppm)
            case faults.ClockJump(robot, ahead_us):
                world.local_clock(robot).jump(ahead_us)
            case _:
                process = world.processes.get(fault.robot)
                if isinstance(fault, _OF_THE_ROBOT) and world.is_coming(fault.robot):
                    world.clock.at(world.clock.now_us + BOOT_US, partial(self.inject, fault))
                elif process is not None and not process.is_over:
                    self._befall(process, fault)

    def _end(self, fault: faults.Kill | faults.KillAfter | faults.Restart) -> None:
        """What befalls a robot whether it has a process yet or not."""
        match fault:
            case faults.Kill(robot):
                self._world.kill(robot)
            case faults.KillAfter(robot, actions):
                self._world.kill_after(robot, actions)
            case faults.Restart(robot, keeps_journal):
                self._world.kill(robot)
                self._world.launch(robot, keeps_journal)

    def _befall(self, process: SimProcess, fault: faults.Fault) -> None:
        """What a process can only suffer while there is one."""
        world = self._world
        match fault:
            case faults.Freeze():
                process.freeze()
            case faults.Suspend():
                process.local.suspend()
                process.freeze()
            case faults.Thaw():
                process.local.resume()
                process.thaw()
            case faults.Slow(_, lag_us):
                process.slow(lag_us)
            case faults.LoseToken(robot, seen_by):
                if process.token is not None:
                    world.arrive(seen_by, TokenChanged(robot, process.token, False))
            case faults.Garbage(robot, count):
                for event in self._forger.inputs(robot, world.setup.robots, count):
                    world.inspection.garbage(process, event)
            case faults.Replay(robot, source, until_us, count):
                past = [m for at_us, m in self._spoken.get(source, ()) if at_us <= until_us]
                for message in past[-count:]:
                    world.arrive(robot, message)
            case _:
                process.deliver(self._input(fault))

    def _input(self, fault: faults.Fault) -> Input:
        """What arrives at the robot itself."""
        match fault:
            case faults.Leave():
                return LeaveRequested()
            case faults.Lose(_, local_task):
                return CapabilityChanged(local_task, lost=True)
            case faults.Restore(_, local_task):
                return CapabilityChanged(local_task, lost=False)
            case faults.Command(_, command, argument):
                body = command_body(command, argument)
                data = encode(self._header, MessageKind.COMMAND, body)
                return QueryReceived(0, MessageKind.COMMAND, data)
        raise TypeError(f"unknown fault {fault!r}")

    def _heal(self, robots: tuple[str, ...]) -> None:
        world = self._world
        world.network.unblock()
        world.network.settle()
        for process in (world.processes[robot] for robot in sorted(world.processes)):
            process.local.set_rate(0)
            process.local.resume()
            if not process.is_over:
                process.slow(0)
                process.thaw()
                process.deliver(CapabilityChanged("all", lost=False))
        for robot in robots:
            if robot not in world.processes or world.processes[robot].is_over:
                world.launch(robot, keeps_journal=True)
        self._resume()

    def _resume(self) -> None:
        """The operator says so again as long as a robot comes with an older word."""
        world = self._world
        for process in world.living():
            if process.agent and process.agent.view.facts.order() is OrderKind.PAUSE:
                process.deliver(self._input(faults.Command(process.robot, ORDER, "resume")))
        world.clock.at(world.clock.now_us + world.timing.detection_us, self._resume)


def fault_text(fault: faults.Fault) -> str:
    """A fault in one word and its values, in a fixed order: `Kill A1`."""
    values = []
    for name in fault.__dataclass_fields__:
        value = getattr(fault, name)
        if isinstance(value, frozenset):
            value = ",".join(f"{source}>{target}" for source, target in sorted(value))
        values.append(str(value))
    return " ".join([type(fault).__name__, *values])
