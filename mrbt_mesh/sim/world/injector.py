"""Fault injection: what each fault of a schedule does to the simulated world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial

from mrbt_mesh.core.agent.commands import ORDER, command_body
from mrbt_mesh.core.agent.inputs import (
    CapabilityChanged,
    Input,
    LeaveRequested,
    MessageReceived,
    PerformanceChanged,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.facts.description import OPERATOR
from mrbt_mesh.core.facts.records import OrderKind
from mrbt_mesh.core.membership.wire import MessageKind, encode
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.garbage import Forger
from mrbt_mesh.sim.world.message_bus import MessageBus
from mrbt_mesh.sim.world.process import Inspection, SimProcess
from mrbt_mesh.sim.world.robots import Robots
from mrbt_mesh.sim.world.setup import Setup

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
    | faults.EndRouter
    | faults.LoseToken  # a suspect is left out when agreement is counted
)
# What a robot lacks from the beginning it finds out once it has started.
_OF_THE_ROBOT = faults.Lose | faults.Restore | faults.ChangePerformance
BOOT_US = 1_000


class Injector:
    """Lets faults happen, until the mission is over where robots stop then.

    `counts`: how many there were, by kind. `pending`: how many of the schedule are still to come.
    `cut_off`: some robot could not hear all others in time for a while. `healed_us`: when all
    faults ended.
    """

    def __init__(
        self,
        setup: Setup,
        bus: MessageBus,
        robots: Robots,
        inspection: Inspection,
        has_result: Callable[[], bool],
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.pending = len(setup.schedule)
        self.cut_off = False
        self.healed_us: int | None = None
        self._setup = setup
        self._bus = bus
        self._robots = robots
        self._inspection = inspection
        self._has_result = has_result
        self._forger = Forger(setup.seed, setup.header)
        # What robots have published, where it may be replayed: (time in us, message).
        self._published: dict[str, list[tuple[int, MessageReceived]]] | None = None
        if any(isinstance(fault, faults.Replay) for _, fault in setup.schedule):
            self._published = {}

    def begin(self) -> None:
        """Schedule the faults that happen at given times."""
        for at_us, fault in sorted(self._setup.schedule, key=lambda item: item[0]):
            self._bus.clock.at(at_us, partial(self._inject_scheduled, fault))

    def heard(self, message: MessageReceived) -> None:
        """A robot has published something; it may be replayed later."""
        if self._published is not None:
            so_far = self._published.setdefault(message.source, [])
            so_far.append((self._bus.clock.now_us, message))

    def _inject_scheduled(self, fault: faults.Fault) -> None:
        self.pending -= 1
        self.inject(fault)

    def inject(self, fault: faults.Fault) -> None:
        """Let one fault happen now."""
        if self._setup.agents.exit_when_done and self._has_result():
            return  # the mission is over, and with it the story
        self._inspection.fault_comes(fault)
        self.counts[type(fault).__name__] += 1
        self.cut_off |= isinstance(fault, _ISOLATING)
        self.cut_off |= isinstance(fault, faults.Heal) and bool(fault.broken)
        self._carry_out(fault)
        if isinstance(fault, faults.Heal):
            self.healed_us = self._bus.clock.now_us

    def _carry_out(self, fault: faults.Fault) -> None:
        network, robots, clock = self._bus.network, self._robots, self._bus.clock
        match fault:
            case faults.Kill() | faults.KillAfter() | faults.Restart():
                self._end(fault)
            case faults.Block(links):
                network.block(links)
            case faults.Unblock(links):
                network.unblock(links)
            case faults.Disturb(link, links):
                network.disturb(link, links)
            case faults.Settle(links):
                network.settle(links)
            case faults.Heal(names, broken):
                self._heal(names)
                network.block(broken)
            case faults.EndRouter() | faults.StartRouter():
                act = (
                    self._bus.end_router
                    if isinstance(fault, faults.EndRouter)
                    else self._bus.routers.begin
                )
                act(fault.router)
            case faults.Disk() | faults.ClockRate() | faults.ClockJump():
                self._change_computer(fault)
            case _:
                process = robots.processes.get(fault.robot)
                if isinstance(fault, _OF_THE_ROBOT) and robots.is_coming(fault.robot):
                    clock.at(clock.now_us + BOOT_US, partial(self._carry_out, fault))
                elif process is not None and not process.is_over:
                    self._suffer(process, fault)

    def _change_computer(self, fault: faults.Disk | faults.ClockRate | faults.ClockJump) -> None:
        """Faults of what outlives a robot's processes."""
        match fault:
            case faults.Disk(robot, sync_us, fails, is_locked):
                self._robots.change_disk(robot, sync_us, fails, is_locked)
            case faults.ClockRate(robot, rate_ppm):
                self._robots.local_clock(robot).set_rate(rate_ppm)
            case faults.ClockJump(robot, ahead_us):
                self._robots.local_clock(robot).jump(ahead_us)

    def _end(self, fault: faults.Kill | faults.KillAfter | faults.Restart) -> None:
        """Faults of a robot whether it has a process yet or not."""
        match fault:
            case faults.Kill(robot):
                self._robots.kill(robot)
            case faults.KillAfter(robot, actions):
                self._robots.kill_after(robot, actions)
            case faults.Restart(robot, keeps_journal):
                self._robots.kill(robot)
                self._robots.launch(robot, keeps_journal)

    def _suffer(self, process: SimProcess, fault: faults.Fault) -> None:
        """What a process can only suffer while there is one."""
        match fault:
            case faults.Freeze():
                process.pace.freeze()
            case faults.Suspend():
                process.local.suspend()
                process.pace.freeze()
            case faults.Thaw():
                process.local.resume()
                process.pace.thaw()
            case faults.Slow(_, lag_us):
                process.pace.slow(lag_us)
            case faults.LoseToken(robot, seen_by):
                if robot in self._bus.tokens:
                    token = self._bus.tokens[robot]
                    self._bus.deliver(seen_by, TokenChanged(robot, token, False))
            case faults.Garbage(robot, count):
                for event in self._forger.inputs(robot, self._setup.robots, count):
                    self._inspection.garbage(process, event)
            case faults.Replay(robot, source, until_us, count):
                published = (self._published or {}).get(source, ())
                past = [message for at_us, message in published if at_us <= until_us]
                for message in past[-count:]:
                    self._bus.deliver(robot, message)
            case _:
                process.deliver(self._input(fault))

    def _input(self, fault: faults.Fault) -> Input:
        """What arrives at the robot itself."""
        match fault:
            case faults.Leave():
                return LeaveRequested()
            case faults.Lose(_, local_task, reason):
                return CapabilityChanged(local_task, True, reason, OPERATOR)
            case faults.Restore(_, local_task):
                return CapabilityChanged(local_task, False, source=OPERATOR)
            case faults.ChangePerformance(_, local_task, performance):
                return PerformanceChanged(local_task, performance)
            case faults.Command(_, command, argument):
                body = command_body(command, argument)
                data = encode(self._setup.header, MessageKind.COMMAND, body)
                return QueryReceived(0, MessageKind.COMMAND, data)
        raise TypeError(f"unknown fault {fault!r}")

    def _heal(self, robots: tuple[str, ...]) -> None:
        processes = self._robots.processes
        self._bus.network.unblock()
        self._bus.network.settle()
        for router in self._bus.routers.names:
            self._bus.routers.begin(router)
        for robot, process in sorted(processes.items()):
            self._robots.change_disk(robot, 0, False, False)
            process.local.set_rate(0)
            process.local.resume()
            if not process.is_over:
                process.pace.slow(0)
                process.pace.thaw()
                process.deliver(CapabilityChanged("all", False, source=OPERATOR))
        for robot in robots:
            if robot not in processes or processes[robot].is_over:
                self._robots.launch(robot, keeps_journal=True)
        self._resume()

    def _resume(self) -> None:
        """The operator says so again as long as a robot comes with an older word."""
        clock = self._bus.clock
        for process in self._robots.living():
            if process.agent and process.agent.view.facts.order() is OrderKind.PAUSE:
                process.deliver(self._input(faults.Command(process.robot, ORDER, "resume")))
        clock.at(clock.now_us + self._setup.timing.detection_us, self._resume)
