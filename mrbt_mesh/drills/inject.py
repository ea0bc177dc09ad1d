"""Carries out the faults of a drill's steps, and notes what was done to which robot."""

from __future__ import annotations

import itertools
import signal
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import anyio
import psutil

from mrbt_mesh.core.agent.operator_messages import FAULT, LEAVE, PERFORM, RESTORE
from mrbt_mesh.drills.journals import Done, read
from mrbt_mesh.drills.model import (
    ROUTER_FAULTS,
    CapabilityModel,
    DecisionModel,
    DelayModel,
    LossModel,
    PerformanceModel,
    Robots,
    StepModel,
)
from mrbt_mesh.drills.network import LinkFaults
from mrbt_mesh.drills.physical import FreezeSpan
from mrbt_mesh.drills.routers import DrillRouters
from mrbt_mesh.drills.triggers import FaultLog, Schedule, Snapshot, chosen
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.launcher import wait_for_exit
from mrbt_mesh.runtime.operator_call import CommandRefusedError
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.runtime.watcher import Watcher


@dataclass(frozen=True)
class InjectedFault:
    """A fault as it was carried out.

    `at_us` is on the observer's clock, `unix_s` on the events' clock.
    """

    at_us: int
    unix_s: float
    fault: str
    robots: tuple[str, ...]
    text: str


@dataclass(frozen=True)
class JournalsAtDeath:
    """The successes in the journals of robots that were just killed, by robot."""

    unix_s: float
    journals: dict[str, frozenset[Done]]


@dataclass
class InjectedFaults:
    """Everything that was done to a team, for the judge. `deaths`: pid -> seconds since 1970.

    `disturbed`: pairs of robots between which packets were blocked, lost or delayed, in any
    direction.
    """

    done: list[InjectedFault] = field(default_factory=list)
    disturbed: set[frozenset[str]] = field(default_factory=set)
    deaths: dict[int, float] = field(default_factory=dict)
    freezes: list[FreezeSpan] = field(default_factory=list)
    journals_at_death: list[JournalsAtDeath] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    fault_log: FaultLog = field(default_factory=FaultLog)

    def hit(self) -> frozenset[str]:
        """Return the robots whose processes were killed, frozen, restarted or made to leave."""
        ways = ("kill", "stop", "restart", "kill_team", "leave")
        return frozenset(
            robot for fault in self.done if fault.fault in ways for robot in fault.robots
        )


class DrillInjector:
    """Carries out steps on one team.

    `network` is None on loopback, `routers` is None without routers.
    """

    def __init__(
        self,
        team: Team,
        watcher: Watcher,
        network: LinkFaults | None,
        routers: DrillRouters | None,
        tell: Callable[[InjectedFault], None],
    ) -> None:
        self.injected = InjectedFaults()
        self._team = team
        self._watcher = watcher
        self._network = network
        self._routers = routers
        self._tell = tell

    async def carry_out_due(self, schedule: Schedule, snapshot: Snapshot) -> bool:
        """Carry out the next step if it is due; return whether it was."""
        step = schedule.due(snapshot, self.injected.fault_log)
        if step is not None:
            await self.carry_out(step, snapshot)
            schedule.carried_out(snapshot.now_us)
        return step is not None

    async def carry_out(self, step: StepModel, snapshot: Snapshot) -> None:
        """Carry out all faults of a step, in the order of its keys."""
        faults = {
            "kill": self._kill,
            "stop": self._stop,
            "continue": self._continue,
            "leave": self._leave,
            "restart": self._restart,
            "join": self._restart,
        }
        for name, fault in step.faults():
            match fault:
                case _ if name in faults:
                    await faults[name](name, self._chosen(fault, snapshot))
                case _ if name == "kill_team":
                    await self._kill(name, list(self._team.living()))
                case _ if name == "resume_team":
                    dead = set(self._team.run_dir.robots()) - set(self._team.living())
                    await self._restart(name, sorted(dead))
                case CapabilityModel(robots=robots, local_task=task):
                    command = FAULT if name == "lose_capability" else RESTORE
                    await self._order(name, self._chosen(robots, snapshot), command, task)
                case PerformanceModel(robots=robots, local_task=task, performance=performance):
                    argument = f"{task}={performance}"
                    await self._order(name, self._chosen(robots, snapshot), PERFORM, argument)
                case DecisionModel(global_task=task, decision=decision):
                    self._note(name, [], f"{task}: {decision}")
                    try:
                        await TeamClient(self._watcher).decide(task, decision)
                    except (CommandRefusedError, TimeoutError) as error:
                        self.injected.problems.append(f"{name}: {error}")
                case _ if name in ROUTER_FAULTS:
                    await anyio.to_thread.run_sync(self._act_on_router, name, fault)
                case _:
                    await self._disturb(name, fault, snapshot)

    def _chosen(self, robots: Robots | None, snapshot: Snapshot) -> list[str]:
        """Return the robots that a step means now; None means all."""
        if robots is None:
            return sorted(self._team.info.endpoints)
        return chosen(robots, snapshot, self.injected.fault_log)

    def _note(self, fault: str, robots: Iterable[str], text: str, at_us: int | None = None) -> None:
        now_us, now_s = boottime_us(), time.time()
        at_us = now_us if at_us is None else at_us
        unix_s = now_s - (now_us - at_us) / 1e6
        injected = InjectedFault(at_us, unix_s, fault, tuple(robots), text)
        self.injected.done.append(injected)
        self._tell(injected)

    def _processes(self, fault: str, robots: Iterable[str]) -> dict[str, psutil.Process]:
        """Return the processes of these robots; a robot without one is noted as a problem."""
        found = {}
        for robot in robots:
            process = self._team.process(robot)
            if process is None:
                self.injected.problems.append(f"{fault}: {robot} had no process any more")
            else:
                found[robot] = process
        return found

    # -- processes ------------------------------------------------------------------------

    async def _kill(self, fault: str, robots: Sequence[str]) -> None:
        processes = self._processes(fault, robots)
        at_us = boottime_us()
        for robot, process in processes.items():
            # Noted before the kill: on a busy machine the next line may run much later.
            self.injected.deaths[process.pid] = time.time()
            process.send_signal(signal.SIGKILL)
            self._watcher.observer.record.exited(robot, at_us)
        self._note(fault, processes, "killed (SIGKILL)", at_us)
        await self._died(processes)

    async def _died(self, processes: dict[str, psutil.Process]) -> None:
        """Wait until killed processes are gone, and save what their journals held then."""
        fault_log = self.injected.fault_log
        for robot, process in processes.items():
            await anyio.to_thread.run_sync(wait_for_exit, process.pid)
            fault_log.lives(robot)
            fault_log.killed.append(robot)
        died_s = time.time()
        run_dir, info = self._team.run_dir, self._team.info
        held = read(run_dir.path, processes, self._team.mission.team_digest, info.run)
        self.injected.journals_at_death.append(JournalsAtDeath(died_s, held))

    async def _stop(self, fault: str, robots: Sequence[str]) -> None:
        for robot, process in self._processes(fault, robots).items():
            self.injected.freezes.append(FreezeSpan(process.pid, time.time()))
            process.send_signal(signal.SIGSTOP)
            self.injected.fault_log.stopped.append(robot)
            self._note(fault, [robot], "frozen (SIGSTOP)")

    async def _continue(self, fault: str, robots: Sequence[str]) -> None:
        for robot, process in self._processes(fault, robots).items():
            now_s = time.time()
            self.injected.freezes = [
                FreezeSpan(f.pid, f.from_s, min(f.to_s, now_s)) if f.pid == process.pid else f
                for f in self.injected.freezes
            ]
            process.send_signal(signal.SIGCONT)
            if robot in self.injected.fault_log.stopped:
                self.injected.fault_log.stopped.remove(robot)
            self.injected.fault_log.thawed.append(robot)
            self._note(fault, [robot], "goes on (SIGCONT)")

    async def _restart(self, fault: str, robots: Sequence[str]) -> None:
        """Start new processes with the same ids and journals; running ones are killed first."""
        for robot in robots:
            if self._team.process(robot) is not None:
                await self._kill(fault, [robot])
            await self._team.start(robot)
            self.injected.fault_log.lives(robot)
            self._note(fault, [robot], "joins" if fault == "join" else "started again")

    # -- words ----------------------------------------------------------------------------

    async def _leave(self, fault: str, robots: Sequence[str]) -> None:
        await self._order(fault, robots, LEAVE, "")
        self.injected.fault_log.left += robots

    async def _order(self, fault: str, robots: Sequence[str], command: str, argument: str) -> None:
        for robot in robots:
            self._note(fault, [robot], f"gets the command: {command} {argument}".rstrip())
            good, text = await self._watcher.command(robot, command, argument)
            if not good:
                self.injected.problems.append(f"{fault}: {robot}: {text}")

    # -- routers --------------------------------------------------------------------------

    def _act_on_router(self, name: str, number: int) -> None:
        routers = self._routers
        assert routers is not None, "checked when the drill was read"
        text = {"kill_router": "killed (SIGKILL)", "stop_router": "frozen (SIGSTOP)"}.get(name)
        if name == "stop_router":
            routers.signal(number, signal.SIGSTOP)
        elif not routers.kill(number) and name == "kill_router":
            self.injected.problems.append(f"{name}: router {number} did not run any more")
        if name == "restart_router":
            routers.start(number)
        self._note(name, (), f"router {number} {text or 'started again'}")

    # -- links ----------------------------------------------------------------------------

    async def _disturb(self, name: str, fault: Any, snapshot: Snapshot) -> None:
        assert self._network is not None, "checked when the drill was read"
        network = self._network
        if name == "heal":
            await anyio.to_thread.run_sync(network.heal)
            self._note(name, (), "the network is whole again")
            return
        if name == "partition":
            groups = self._groups(fault, snapshot)
            await anyio.to_thread.run_sync(lambda: network.partition(*groups))
            self.injected.disturbed |= {
                frozenset((one, other))
                for left, right in itertools.combinations(groups, 2)
                for one in left
                for other in right
            }
            text = " | ".join(" ".join(group) for group in groups)
            self._note(name, (), f"partition: {text}")
            return
        sources, targets = (
            self._chosen(fault.source, snapshot),
            self._chosen(fault.target, snapshot),
        )
        pairs = [(s, t) for s in sources for t in targets if s != t]
        if name != "unblock":
            self.injected.disturbed |= {frozenset(pair) for pair in pairs}
        match fault:
            case LossModel(permille=permille):
                changes: dict[str, Any] = {"loss_permille": permille}
                text = f"{permille / 10:g} % loss ({network.loss_tool})"
            case DelayModel(ms=delay_ms):
                changes, text = {"delay_ms": delay_ms}, f"{delay_ms} ms delay"
            case _:
                changes = {"blocked": name == "block"}
                text = "blocked" if name == "block" else "open again"
        await anyio.to_thread.run_sync(lambda: network.disturb(pairs, **changes))
        self._note(name, (), f"{' '.join(sources)} → {' '.join(targets)}: {text}")

    def _groups(self, fault: list[Robots], snapshot: Snapshot) -> list[list[str]]:
        """Return the groups of a partition; robots that no group names form one more."""
        groups = [self._chosen(group, snapshot) for group in fault]
        named = {robot for group in groups for robot in group}
        rest = [robot for robot in sorted(self._team.info.endpoints) if robot not in named]
        return [*groups, rest] if rest else groups
