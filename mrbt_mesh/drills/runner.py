"""Runs one drill on a team of real processes, from the launch to the results."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import RECORDING
from mrbt_mesh.drills.beside import beside
from mrbt_mesh.drills.drill_file import Drill
from mrbt_mesh.drills.inject import DrillInjector, InjectedFault
from mrbt_mesh.drills.journals import read
from mrbt_mesh.drills.judge import DrillResult, Evidence, judge
from mrbt_mesh.drills.links import read_links
from mrbt_mesh.drills.model import Profile
from mrbt_mesh.drills.network import LinkFaults, places
from mrbt_mesh.drills.recorded_work import read_work
from mrbt_mesh.drills.routers import DrillRouters, routers
from mrbt_mesh.drills.triggers import Schedule, Snapshot
from mrbt_mesh.formats.mission_file import compile_mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.summary import run_summary
from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.known_runs import remember
from mrbt_mesh.runtime.launcher_lock import launched_from_here
from mrbt_mesh.runtime.observer_recording import RecordTo
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir, write_atomically
from mrbt_mesh.runtime.team import Team, new_run
from mrbt_mesh.runtime.team_address import address_of
from mrbt_mesh.runtime.watcher import Watcher, watching

FRAME_S = 0.1
# Environment variable with the file that lists held tasks: see agents/simulated.py.
HOLD_VARIABLE, HOLD_FILE = "MRBT_HOLD", "hold"


@dataclass(frozen=True)
class TimelineEntry:
    """One line of a drill's timeline. `is_fault`: the drill caused it."""

    at_s: float
    robot: str
    text: str
    is_fault: bool = False


@dataclass
class DrillRun:
    """The outcome of one run of a drill. `skipped`: why it was not run at all."""

    label: str
    profile: Profile
    result: str = ""
    duration_s: float = 0.0
    results: list[DrillResult] = field(default_factory=list)
    timeline: list[TimelineEntry] = field(default_factory=list)
    takeovers: list[dict[str, Any]] = field(default_factory=list)
    run_dir: Path | None = None
    skipped: str | None = None

    @property
    def is_green(self) -> bool:
        """True if all expectations held. Also true for a skipped run, which proves nothing."""
        return all(result.holds for result in self.results)

    @property
    def color(self) -> str:
        """`green`, `red` or `skipped`."""
        if self.skipped is not None:
            return "skipped"
        return "green" if self.is_green else "red"


async def run_drill(
    drill: Drill, profile: Profile, folder: Path, tell: Callable[[TimelineEntry], None]
) -> DrillRun:
    """Run a drill in a new run directory; `tell` gets the timeline as it happens.

    In any case, no process of the team or beside it is left behind. Raises TransportError,
    RunDirError, NamespaceError, RoutersError, BesideError.
    """
    begun_s = time.monotonic()
    with (
        places(drill.model.network, sorted(drill.mission.robots)) as (network, found),
        routers(drill.model.routers) as between,
        beside(drill.model.beside, drill.path.parent, os.environ) as around,
    ):
        timing = drill.model.timing
        options = RobotOptions(
            program=drill.mission.program,
            beat_s=timing.beat_s,
            detection_s=timing.detection_s,
            speed=drill.model.speed,
            transport=profile,
            routers=tuple(between.endpoints) if between is not None else (),
        )
        path, robots = drill.mission_path, drill.robots
        info = new_run(drill.mission, path, robots, options, places=found, record=True)
        run_dir = RunDir.create(folder, info, compile_mission(drill.mission))
        remember(run_dir)
        hold = run_dir.path / HOLD_FILE
        environment = {HOLD_VARIABLE: str(hold), **around.environment}
        team = Team(run_dir, info, drill.mission, environment)
        run = _Run(drill, team, network, between, hold, tell)
        with launched_from_here(run_dir):
            try:
                await team.start_all()
                to = RecordTo(observer_file(run_dir.path), speed=drill.model.speed)
                async with watching(address_of(run_dir), to) as watcher:
                    evidence = await run.to_the_end(watcher)
            finally:
                with anyio.CancelScope(shield=True):
                    await team.end()
        evidence.beside_ended = around.ended()
        evidence.checks = [around.check(command) for command in drill.model.expect.checks]
    evidence.crashes = team.crashes()
    ran = run_dir.robots()
    evidence.events, recorded = read_work(run_dir.path)
    evidence.unrecorded |= set(ran) - recorded
    evidence.logs = sum(run_dir.log_path(robot).exists() for robot in ran)
    evidence.links = read_links(run_dir.path, ran)
    evidence.journals = read(run_dir.path, ran, drill.mission.team_digest, info.run)
    return DrillRun(
        drill.label,
        profile,
        evidence.result,
        time.monotonic() - begun_s,
        judge(drill.model.expect, drill.mission, evidence),
        sorted(run.timeline, key=lambda line: line.at_s),
        evidence.takeovers,
        run_dir.path,
    )


class _Run:
    """One run of a drill. Simulated robots do not finish tasks listed in the file `hold`."""

    def __init__(
        self,
        drill: Drill,
        team: Team,
        network: LinkFaults | None,
        between: DrillRouters | None,
        hold: Path,
        tell: Callable[[TimelineEntry], None],
    ) -> None:
        self.drill = drill
        self.team = team
        self.network = network
        self.between = between
        self.hold = hold
        self.schedule = Schedule(drill.steps)
        self._hold_tasks()
        self.timeline: list[TimelineEntry] = []
        self._tell = tell
        self._shown = 0

    async def to_the_end(self, watcher: Watcher) -> Evidence:
        """Follow the team, carry out steps, and collect what the judge needs."""
        observer = watcher.observer
        schedule = self.schedule
        injector = DrillInjector(
            self.team,
            watcher,
            self.network,
            self.between,
            lambda fault: self._show_fault(observer, fault),
        )
        async with anyio.create_task_group() as group:
            group.start_soon(self.team.note_exits, watcher)
            why = await self._until_over(watcher, injector)
            group.cancel_scope.cancel()
        self._news(observer)
        result = self.team.result(observer, boottime_us())
        record = observer.record
        injected = injector.injected
        injected.problems += self.team.refusals()
        return Evidence(
            result=result,
            ended_because=why,
            steps_left=[
                f"step {index + 1} of {len(schedule.steps)}"
                for index in range(schedule.next, len(schedule.steps))
            ],
            injected=injected,
            states={robot: observer.robot_state(robot) for robot in observer.robots()},
            takeovers=[
                takeover | {"inflicted": fault.robot in injected.hit(), "ended": fault.exact}
                for takeover, fault in zip(
                    run_summary(observer, result, boottime_us())["takeovers"],
                    record.major,
                    strict=True,
                )
            ],
            unrecorded={robot for robot, subject in record.problems if subject == RECORDING},
            blocked=frozenset(episode.request for episode in record.blocked),
            is_obsolete=lambda activation: observer.mission.evaluator.is_obsolete(
                parse_activation(activation), observer.facts
            ),
        )

    async def _until_over(self, watcher: Watcher, injector: DrillInjector) -> str | None:
        """Return why the run ended before the mission did, or None if the mission is over."""
        schedule, observer, fault_log = self.schedule, watcher.observer, injector.injected.fault_log
        deadline_s = time.monotonic() + self.drill.model.timeout_s
        wait_s = FRAME_S
        while True:
            await watcher.wait_for_change(wait_s)
            self._news(observer)
            snapshot = schedule.look(observer)
            if await injector.carry_out_due(schedule, snapshot):
                self._hold_tasks()
                wait_s = 0.0
                continue
            if observer.record.result is not None:
                return None
            if time.monotonic() >= deadline_s:
                return f"not over after {self.drill.model.timeout_s:g} s"
            if schedule.is_over and self._is_blocked_for_good(snapshot, observer):
                return "blocked, as expected"
            due_us = schedule.due_us(snapshot, fault_log)
            if due_us is None and not self.team.living():
                return "no robot is left"
            wait_s = FRAME_S
            if due_us is not None:
                wait_s = min(FRAME_S, max(0.0, (due_us - boottime_us()) / 1e6))

    def _hold_tasks(self) -> None:
        write_atomically(self.hold, "".join(f"{task}\n" for task in sorted(self.schedule.held())))

    def _is_blocked_for_good(self, snapshot: Snapshot, observer: Observer) -> bool:
        """True once the expected block has lasted for a detection time."""
        if self.drill.model.expect.result != "blocked":
            return False
        standing = [e.from_us for e in observer.record.blocked if e.to_us is None]
        detection_us = self.drill.model.timing.detection_s * 1e6
        return bool(standing) and snapshot.now_us >= min(standing) + detection_us

    # -- the timeline ---------------------------------------------------------------------

    def _news(self, observer: Observer) -> None:
        """Show the new entries of the observer's record."""
        record = observer.record
        for _, (at_us, text) in record.timeline.since(self._shown):
            robot, _, rest = text.partition(" ")
            if robot.rstrip(":") in record.robots:
                line = TimelineEntry(record.seconds(at_us) or 0.0, robot.rstrip(":"), rest)
            else:
                line = TimelineEntry(record.seconds(at_us) or 0.0, "", text)
            self._say(line)
        self._shown = record.timeline.total

    def _show_fault(self, observer: Observer, fault: InjectedFault) -> None:
        at_s = observer.record.seconds(fault.at_us) or 0.0
        self._say(TimelineEntry(at_s, " ".join(fault.robots), fault.text, is_fault=True))

    def _say(self, line: TimelineEntry) -> None:
        self.timeline.append(line)
        self._tell(line)
