"""One team as its launcher sees it: how a run begins, its processes, and how they end."""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import anyio
import anyio.abc
import psutil

from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.episodes import DeathTimes
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.runtime.capacity import allow_open_files
from mrbt_mesh.runtime.command_log import last_end
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.journal import read_journals
from mrbt_mesh.runtime.launcher import (
    PORT,
    StartedRobot,
    agent_arguments,
    agent_command,
    ensure_keys,
    free_endpoints,
    lower_dials,
    start_robot,
    wait_for_exit,
    with_newcomer,
)
from mrbt_mesh.runtime.logged_deaths import LoggedDeaths
from mrbt_mesh.runtime.noted_problems import take_noted_problems
from mrbt_mesh.runtime.past import last_records
from mrbt_mesh.runtime.robot_forks import CAN_FORK, ForkedRobot, RobotForks
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import Place, RunDir, RunInfo
from mrbt_mesh.runtime.session_config import TransportConfig
from mrbt_mesh.runtime.settings import (
    ENCRYPTED,
    WARNING,
    WIRELESS,
    default_protocol,
)
from mrbt_mesh.runtime.team_address import AddressError, timing_of
from mrbt_mesh.runtime.watcher import Watcher

END_TIMEOUT_S = 3.0
# How often to look for new processes, and for times of deaths.
EXITS_LOOK_S = 0.5
# The number of robots started at once, and how long to wait for them before the next ones.
STARTED_AT_ONCE = 8
UP_TIMEOUT_S, UP_LOOK_S = 5.0, 0.02
MAX_PORT = 65_535
# A living robot that has keys signs its recording at least this often.
MARK_S = 3.0
# A robot's exit status if its mission has failed, and if it refuses its input.
FAILED, REFUSED = 1, 2


def new_run(
    mission: Mission,
    mission_path: Path,
    robots: Sequence[str],
    options: RobotOptions,
    *,
    places: Mapping[str, Place] | None = None,
    record: bool = False,
) -> RunInfo:
    """Return a new run, with fresh ids and free endpoints.

    `options` are shared by all robots; the first robot serves metrics on `metrics_port`, the others
    on the ports that follow. `places` says where each robot runs that takes part or may join later;
    by default they run on loopback. Raises AddressError for options that contradict each other, and
    TransportError for routers that the robots cannot be clients of.
    """
    transport = options.transport
    if transport == WIRELESS and options.insecure:
        raise AddressError("the transport wireless is encrypted, and so needs keys: no --insecure")
    endpoints = dict.fromkeys(robots, "")
    protocol = default_protocol(transport, has_certificates=False)
    if options.routers:
        _check_routers(options.routers, transport)
    elif places:
        endpoints = {r: f"{protocol}/{places[r].address}:{PORT}" for r in robots}
    else:
        endpoints = dict(zip(robots, free_endpoints(len(robots), protocol), strict=True))
    team = f"{mission.name[:24]}-{secrets.token_hex(3)}"
    info = RunInfo(
        mission_path=str(mission_path.resolve()),
        mission_name=mission.name,
        options=replace(options, team=team, run=secrets.token_hex(4)),
        endpoints=endpoints,
        dials=lower_dials(robots),
        started_unix_s=time.time(),
        robots=tuple(robots),
        places=places or {},
        record=record,
        metrics_ports=_metrics_ports(robots, options.metrics_port),
    )
    timing_of(options.beat_s, options.detection_s, mission)
    return info


def _metrics_ports(robots: Sequence[str], first: int | None) -> dict[str, int]:
    if first is None:
        return {}
    if first + len(robots) - 1 > MAX_PORT:
        raise AddressError(
            f"{len(robots)} robots have no ports from {first} on: {MAX_PORT} is the last"
        )
    return {robot: first + number for number, robot in enumerate(robots)}


def _check_routers(routers: Sequence[str], transport: str) -> None:
    encrypted = [each for each in routers if each.partition("/")[0] in ENCRYPTED]
    if encrypted or transport == WIRELESS:
        raise AddressError(
            "the robots of a run have keys of their own, which no router knows: "
            "over tls or quic they are clients of a router with `mrbt agent --keys`"
        )
    TransportConfig("", "", routers=tuple(routers), profile=transport)


class Team:
    """The processes of one run. `processes` are those started by this object.

    `environment` has variables that are added to the environment of the processes.
    """

    def __init__(
        self,
        run_dir: RunDir,
        info: RunInfo,
        mission: Mission,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.run_dir = run_dir
        self.info = info
        self.mission = mission
        self.environment = dict(environment or {})
        self.processes: dict[str, StartedRobot] = {}
        self._forks: RobotForks | None = None
        self._started_ns = 0
        # Robot -> the size of its output before it was started from here.
        self._printed_before: dict[str, int] = {}

    async def start(
        self, robot: str, *, robot_type: str | None = None, takeover: bool = False
    ) -> StartedRobot:
        """Start a robot: a member of the team, a newcomer, or a dead one again.

        A dead robot returns to its own endpoint, but one that is to be replaced still holds its
        endpoint. Raises RunDirError if the run has no place for the robot, KeysError if it can get
        no key.
        """
        if robot not in self.info.endpoints or self.process(robot) is not None:
            self.info = with_newcomer(self.info, robot)
            self.run_dir.save(self.info)
        ensure_keys(self.run_dir, self.info, robot)
        arguments = agent_arguments(self.run_dir, self.info, robot, robot_type, takeover)
        if self._forks is not None:
            self.processes |= await self._fork({robot: arguments})
        else:
            command = agent_command(self.info, robot, arguments)
            with contextlib.suppress(OSError):
                self._printed_before[robot] = self.run_dir.output_path(robot).stat().st_size
            started = await start_robot(self.run_dir, robot, command, self.environment)
            self.processes[robot] = started
        return self.processes[robot]

    async def _fork(self, arguments: Mapping[str, Sequence[str]]) -> dict[str, ForkedRobot]:
        assert self._forks is not None
        return await anyio.to_thread.run_sync(self._forks.start, arguments)

    async def start_all(self) -> None:
        """Start the robots with which the run begins.

        They are forked from one process, unless they have places of their own. Raises RunDirError,
        and InputError before any is started if the system allows too few open files.
        """
        allow_open_files(len(self.info.robots))
        self._started_ns = time.time_ns()
        if not CAN_FORK or self.info.places or len(self.info.robots) == 1:
            for robot in self.info.robots:
                await self.start(robot)
            return
        for robot in self.info.robots:
            ensure_keys(self.run_dir, self.info, robot)
        arguments = {r: agent_arguments(self.run_dir, self.info, r) for r in self.info.robots}
        self._forks = RobotForks(self.run_dir, self.environment, self.mission.may_need_arrays)
        for first in range(0, len(arguments), STARTED_AT_ONCE):
            robots, before_ns = list(arguments)[first : first + STARTED_AT_ONCE], time.time_ns()
            self.processes |= await self._fork({robot: arguments[robot] for robot in robots})
            if first + STARTED_AT_ONCE < len(arguments):
                await self._until_up(robots, before_ns)

    @property
    def is_launched_here(self) -> bool:
        """True if this object launched the team, rather than found it running."""
        return self._started_ns > 0

    async def until_up(self, timeout_s: float) -> list[str]:
        """Wait until all robots started here have opened their sessions, or ended.

        Returns the robots that have done neither.
        """
        return await self._until_up([*self.processes], self._started_ns, timeout_s)

    async def _until_up(
        self, robots: Sequence[str], before_ns: int, timeout_s: float = UP_TIMEOUT_S
    ) -> list[str]:
        """Wait until these robots have opened their sessions, because many that start at once
        starve each other.

        Waits at most `timeout_s`: robots that end or hang do not delay the rest.
        """
        waiting, begun_ns = set(robots), dict.fromkeys(robots, before_ns)
        with anyio.move_on_after(timeout_s):
            while waiting:
                await anyio.sleep(UP_LOOK_S)
                for robot in sorted(waiting):
                    mark_ns = self.run_dir.alive_mark_ns(robot)
                    if (
                        self.processes[robot].returncode is not None
                        or mark_ns > begun_ns[robot] > before_ns
                    ):
                        waiting.discard(robot)
                    elif mark_ns > before_ns:
                        begun_ns[robot] = mark_ns  # it has begun; its next mark means it is up
        return sorted(waiting)

    def process(self, robot: str) -> psutil.Process | None:
        """Return the robot's process, wherever it was started, even if it is only just starting."""
        started = self.processes.get(robot)
        if started is not None and started.returncode is None:
            # It writes its pid to the run directory only later in its startup.
            with contextlib.suppress(psutil.NoSuchProcess):
                process = psutil.Process(started.pid)
                return process if process.status() != psutil.STATUS_ZOMBIE else None
        return self.run_dir.process(robot)

    def living(self) -> dict[str, psutil.Process]:
        """Return the running processes of this run, by robot."""
        robots = sorted({*self.run_dir.robots(), *self.processes})
        found = {robot: self.process(robot) for robot in robots}
        return {robot: process for robot, process in found.items() if process is not None}

    def journals(
        self, on_problem: Callable[[str], None] = lambda _: None
    ) -> dict[str, tuple[Entry, ...]]:
        """Return robot -> the entries in its journal.

        `on_problem` is called for each unusable journal.
        """
        robots = sorted({*self.run_dir.robots(), *self.processes})
        mission = self.mission.team_digest
        return read_journals(self.run_dir.path, robots, mission, self.info.run, on_problem)

    def result(self, observer: Observer, now_us: int) -> str:
        """Return the run's result if it ends now, from the observer and the journals.

        A short mission may be over before it could be watched; its journals have the result.
        """
        lives = bool(self.living())
        if observer.record.result is None and not lives:
            entries = (entry for kept in self.journals().values() for entry in kept)
            observer.read(entries, now_us)
        return observer.result(lives)

    def note_unseen_deaths(self, observer: Observer, now_us: int) -> None:
        """Record deaths known only from the robots' recordings, once no robot is left.

        Robots that were still there when an operator ended the team have left, not died. What
        nothing has recorded is not known: files' times of modification change when they are copied.
        """
        if observer.record.result is not None or self.living():
            return
        end, recorded = last_end(self.run_dir), last_records(observer, self.run_dir.path)
        ago_us = boottime_us() - round(time.time() * 1e6)
        for robot in self.run_dir.robots():
            last = recorded.get(robot)
            if end is not None:
                since_us = round((end.unix_s - MARK_S) * 1e6) + ago_us
                if last is None or last.is_end or last.at_us >= since_us:
                    continue
            observer.record.died_unseen(robot, now_us, None if last is None else last.at_us)

    def refusals(self) -> list[str]:
        """Return the output of robots that were started here and refused their input."""
        self._settle()
        found = []
        for robot, process in self.processes.items():
            if process.returncode == REFUSED:
                path, said = self.run_dir.output_path(robot), ""
                with contextlib.suppress(OSError):
                    said = path.read_text(encoding="utf-8", errors="replace").strip()
                found.append(said or f"error: {self._wordless(robot, REFUSED)}")
        return found

    def _wordless(self, robot: str, status: int) -> str:
        path = self.run_dir.output_path(robot)
        return (
            f"{robot} ended with status {status} and could not write why to {path}: "
            "is its disk full?"
        )

    def last_word(self, robot: str, status: int) -> str:
        """Return the last line printed by a robot that was started here and has ended."""
        said = ""
        with contextlib.suppress(OSError), self.run_dir.output_path(robot).open("rb") as file:
            # The part before is from earlier lives, unless the file was started anew.
            before = self._printed_before.get(robot, 0)
            file.seek(before if file.seek(0, os.SEEK_END) >= before else 0)
            said = file.read().decode(errors="replace").strip().rpartition("\n")[2]
        return said or self._wordless(robot, status)

    def _settle(self) -> None:
        """Collect the exit statuses of robots that have ended."""
        for process in self.processes.values():
            if isinstance(process, ForkedRobot):
                process.settle()

    def crashes(self) -> list[str]:
        """Return the robots that were started here and ended by an error, with their last words.

        Refusals do not count, nor SIGTERM and SIGKILL, nor status 1 without output: a robot of a
        failed mission ends that way.
        """
        self._settle()
        found = []
        for robot, process in sorted(self.processes.items()):
            status = process.returncode
            if status in (None, 0, REFUSED, -signal.SIGTERM, -signal.SIGKILL):
                continue
            with contextlib.suppress(OSError):
                said = (
                    self.run_dir.output_path(robot)
                    .read_text(encoding="utf-8", errors="replace")
                    .strip()
                    .splitlines()
                )
                words = [line for line in said if not line.startswith(WARNING)]
                if words or status != FAILED:
                    last = words[-1] if words else "no word"
                    found.append(f"{robot} ended with status {status}: {last}")
        return found

    async def note_exits(self, watcher: Watcher) -> None:
        """Record exactly when and why processes end, and what blocks them. Never returns.

        The launcher of the team also collects the times of deaths from the robots' logs, and writes
        them to the run directory, where other observers on this machine find them.
        """
        awaited: set[str] = set()
        record = watcher.observer.record

        async def note(robot: str, pid: int) -> None:
            at_us = await anyio.to_thread.run_sync(wait_for_exit, pid, abandon_on_cancel=True)
            awaited.discard(robot)
            record.exited(robot, at_us)
            watcher.changed.set()

        written: list[DeathTimes] = []
        logged = LoggedDeaths(self.run_dir)

        def share_deaths() -> None:
            nonlocal written
            times = [fault.times for fault in record.major]
            if not self.is_launched_here:
                for death in self.run_dir.deaths(boottime_us()) if times else ():
                    record.death_recorded(*death)
            elif times != written:
                now_us = boottime_us()
                logged.look()
                for fault in record.major:
                    found = logged.times_of(fault, now_us)
                    record.death_recorded(fault.robot, fault.incarnation, found)
                written = [fault.times for fault in record.major]
                self.run_dir.write_deaths(record.major, now_us)
                watcher.changed.set()

        async with anyio.create_task_group() as group:
            while True:
                share_deaths()
                for robot in {*self.run_dir.robots(), *self.processes} - awaited:
                    process = self.process(robot)
                    if process is not None:
                        awaited.add(robot)
                        group.start_soon(note, robot, process.pid)
                if take_noted_problems(self.run_dir, record, boottime_us()):
                    watcher.changed.set()
                await anyio.sleep(EXITS_LOOK_S)

    async def end(self) -> None:
        """Wait for the robots to stop by themselves, then terminate them, then kill them."""
        for step in ("wait", "terminate", "kill"):
            for process in self.living().values():
                with contextlib.suppress(psutil.Error):
                    if step == "terminate":
                        process.terminate()
                    elif step == "kill":
                        process.kill()
            with anyio.move_on_after(
                END_TIMEOUT_S if step != "wait" else self.info.options.beat_s * 4
            ):
                while self.living():
                    await anyio.sleep(0.02)
                break
        if self._forks is not None:
            await anyio.to_thread.run_sync(self._forks.close)
            self._forks = None
