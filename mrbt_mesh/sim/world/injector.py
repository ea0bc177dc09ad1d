"""Fault injection: the effect of each fault of a schedule on the simulated world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

from mrbt_mesh.core.agent.inputs import (
    CapabilityChanged,
    Input,
    LeaveRequested,
    MessageReceived,
    PerformanceChanged,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.agent.operator_messages import command_body
from mrbt_mesh.core.facts.description import OPERATOR
from mrbt_mesh.core.facts.records import PAUSED, TeamOrder
from mrbt_mesh.core.membership.wire import MessageKind, encode
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.client import Client
from mrbt_mesh.sim.world.garbage import Forger
from mrbt_mesh.sim.world.message_bus import MessageBus
from mrbt_mesh.sim.world.process import Inspection, SimProcess
from mrbt_mesh.sim.world.robots import Robots
from mrbt_mesh.sim.world.setup import Setup
from mrbt_mesh.sim.world.team_commands import TeamCommand

# Faults after which a robot may not hear all others in time.
_ISOLATING = (
    faults.Block
    | faults.Freeze
    | faults.Suspend
    | faults.Pause
    | faults.Restart
    | faults.Slow
    | faults.ClockJump
    | faults.Disturb
    | faults.Replay
    | faults.EndRouter
    | faults.LoseToken  # a suspect is left out when agreement is counted
)
# A robot that is starting notices these right after its start.
_OF_THE_ROBOT = faults.Lose | faults.Restore | faults.ChangePerformance
BOOT_US = 1_000


class Injector:
    """Carries out faults and commands, until the mission is over if robots stop then.

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
        client: Client,
        has_result: Callable[[], bool],
    ) -> None:
        self.client = client
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
        # What robots have published, if it may be replayed: (time in us, message).
        self._published: dict[str, list[tuple[int, MessageReceived]]] | None = None
        if any(isinstance(fault, faults.Replay) for _, fault in setup.schedule):
            self._published = {}
        network = bus.network
        self._of_the_world: dict[type[faults.Fault], Callable[[Any], object]] = {
            faults.Kill: lambda f: robots.kill(f.robot),
            faults.KillAfter: lambda f: robots.kill_after(f.robot, f.actions),
            faults.Restart: self._restart,
            faults.Disk: lambda f: robots.change_disk(f.robot, f.sync_us, f.fails, f.is_locked),
            faults.ClockRate: lambda f: robots.local_clock(f.robot).set_rate(f.rate_ppm),
            faults.ClockJump: lambda f: robots.local_clock(f.robot).jump(f.ahead_us),
            faults.SetWallClock: lambda f: robots.local_clock(f.robot).set_wall_clock(
                f.ahead_us, f.drift_ppm
            ),
            faults.Block: lambda f: network.block(f.links),
            faults.Unblock: lambda f: network.unblock(f.links),
            faults.Disturb: lambda f: network.disturb(f.link, f.links),
            faults.Settle: lambda f: network.settle(f.links),
            faults.EndRouter: lambda f: bus.end_router(f.router),
            faults.StartRouter: lambda f: bus.routers.begin(f.router),
            faults.Heal: self._heal,
        }
        self._of_a_process: dict[type[faults.Fault], Callable[[SimProcess, Any], object]] = {
            faults.Freeze: lambda process, _: process.pace.freeze(),
            faults.Suspend: lambda process, _: process.suspend(),
            faults.Pause: lambda process, _: process.pause(),
            faults.Thaw: lambda process, _: process.thaw(),
            faults.Slow: lambda process, f: process.pace.slow(f.lag_us),
            faults.LoseToken: lambda _, f: self._lose_token(f),
            faults.Garbage: self._send_garbage,
            faults.Replay: lambda _, f: self._replay(f),
        }

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
            if isinstance(fault, TeamCommand):
                self.client.refuse(fault, "the mission is over")
            return
        self._inspection.fault_comes(fault)
        self.counts[type(fault).__name__] += 1
        self.cut_off |= isinstance(fault, _ISOLATING)
        self.cut_off |= isinstance(fault, faults.Heal) and bool(fault.broken)
        self._carry_out(fault)

    def _carry_out(self, fault: faults.Fault) -> None:
        if type(fault) in self._of_the_world:
            self._of_the_world[type(fault)](fault)
            return
        if isinstance(fault, TeamCommand):
            self.client.give(fault)
            return
        assert isinstance(fault, faults.RobotFault)
        process, clock = self._robots.processes.get(fault.robot), self._bus.clock
        if isinstance(fault, _OF_THE_ROBOT) and self._robots.is_coming(fault.robot):
            clock.at(clock.now_us + BOOT_US, partial(self._carry_out, fault))
        elif process is not None and not process.is_over:
            if isinstance(fault, faults.Revise):
                self.client.revise(process, fault)
            elif isinstance(fault, faults.Operate):
                self.client.operate(process, fault)
            elif type(fault) in self._of_a_process:
                self._of_a_process[type(fault)](process, fault)
            else:
                process.deliver(self._input(fault))

    def _lose_token(self, fault: faults.LoseToken) -> None:
        token = self._bus.tokens.get(fault.robot)
        if token is not None:
            self._bus.deliver(fault.seen_by, TokenChanged(fault.robot, token, False))

    def _send_garbage(self, process: SimProcess, fault: faults.Garbage) -> None:
        for event in self._forger.inputs(fault.robot, self._setup.robots, fault.count):
            self._inspection.garbage(process, event)

    def _replay(self, fault: faults.Replay) -> None:
        published = (self._published or {}).get(fault.source, ())
        past = [message for at_us, message in published if at_us <= fault.until_us]
        for message in past[-fault.count :]:
            self._bus.deliver(fault.robot, message)

    def _restart(self, fault: faults.Restart) -> None:
        if self._robots.is_known(fault.robot):
            self._robots.restart(fault.robot, fault.keeps_journal)
        else:
            self.client.refuse(fault, f"the mission in force has no robot {fault.robot}")

    def _input(self, fault: faults.RobotFault) -> Input:
        """The input that the robot itself receives."""
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

    def _heal(self, heal: faults.Heal) -> None:
        processes, bus = self._robots.processes, self._bus
        bus.network.unblock()
        bus.network.settle()
        for router in bus.routers.names:
            bus.routers.begin(router)
        for robot, process in sorted(processes.items()):
            self._robots.change_disk(robot, 0, False, False)
            process.local.set_rate(0)
            process.local.set_wall_clock(0, 0)
            process.local.resume()
            if not process.is_over:
                process.pace.slow(0)
                process.pace.thaw()
                process.deliver(CapabilityChanged("all", False, source=OPERATOR))
        for robot in heal.robots:
            if robot not in processes or processes[robot].is_over:
                self._robots.launch(robot, keeps_journal=True)
        self._resume()
        bus.network.block(heal.broken)
        self.healed_us = bus.clock.now_us

    def _resume(self) -> None:
        """End a pause, again and again: a robot may come with an older command."""
        clock = self._bus.clock
        for process in self._robots.living():
            if process.agent and process.agent.view.facts.order() is TeamOrder.PAUSE:
                order = faults.Operate(process.robot, PAUSED, "resume")
                self.client.operate(process, order)
        clock.at(clock.now_us + self._setup.timing.detection_us, self._resume)
