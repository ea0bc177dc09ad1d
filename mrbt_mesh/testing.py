"""Tests of a mission with its robots' own programs, in virtual time, with faults and commands.

    from mrbt_mesh.testing import Kill

    def test_the_other_porter_takes_over(run_mission):      # a fixture of pytest
        run = run_mission("mission.yaml", faults=[(5.0, Kill("P1"))])
        assert run.result == "success"
        assert run.succeeded("carry(red)") == ["P2"]

    def test_a_job(run_mission):
        run = run_mission(
            "mission.yaml", commands=[(1.0, Submit("carry", ["red"]))], until_jobs_end=True
        )
        assert run.job("job-1").state == "succeeded"

A run of minutes takes milliseconds, and is the same each time. Programs wait with `anyio.sleep` or
`asyncio.sleep`; what they do apart from the event loop takes no virtual time.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import fspath
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias

from mrbt_mesh.core.mission.mission import MICRO, Mission, micro_performance
from mrbt_mesh.core.mission.names import ALL, type_name
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.features.contact.commands import Borrow, Return
from mrbt_mesh.formats.expand import call_text
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program import RobotProgram, functions_of
from mrbt_mesh.runtime.program_loader import load_program, require_program
from mrbt_mesh.sim import (
    ChangePerformance,
    Freeze,
    Kill,
    Leave,
    LinkKnobs,
    Lose,
    NetworkKnobs,
    Restart,
    Restore,
    SimulationResult,
    Thaw,
    simulate,
)
from mrbt_mesh.sim.world.named_faults import (
    NamedFault,
    check_faults,
    check_local_task,
    check_number,
    check_robot,
    is_local_task,
    local_task_names,
    missed,
)
from mrbt_mesh.sim.world.team_commands import (
    AbortMission,
    CancelJob,
    HoldJob,
    PauseTeam,
    ReleaseJob,
    ResumeTeam,
    SetPriority,
    Submit,
)
from mrbt_mesh.testing_commands import (
    Command,
    File,
    JobResult,
    Missions,
    NamedCommand,
    ReviseMission,
    job_results,
    read_commands,
    timed,
)

__all__ = [
    "AbortMission",
    "Borrow",
    "CancelJob",
    "Command",
    "Event",
    "Failure",
    "Fault",
    "Freeze",
    "HoldJob",
    "JobResult",
    "Kill",
    "Leave",
    "Lose",
    "MissionRun",
    "NetworkQuality",
    "ObservedFault",
    "PauseTeam",
    "Perform",
    "Refused",
    "ReleaseJob",
    "Restart",
    "Restore",
    "ResumeTeam",
    "Return",
    "ReviseMission",
    "RunMission",
    "SetPriority",
    "Submit",
    "Thaw",
    "run",
]


@dataclass(frozen=True, slots=True)
class Perform:
    """From now on the robot does a local task (a type or a ground one) this well, 0 to 1e6.

    It replaces the mission file's performance; 0 is a minor fault.
    """

    robot: str
    local_task: str
    performance: float


Fault: TypeAlias = Kill | Restart | Freeze | Thaw | Leave | Lose | Restore | Perform


@dataclass(frozen=True, slots=True)
class NetworkQuality:
    """How messages travel: `loss`, `duplicate` and `reorder` are shares of them, 0 to 1.

    A message takes `delay_s` and up to `jitter_s` more.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_s: float = 0.001
    jitter_s: float = 0.001

    def __post_init__(self) -> None:
        for name in ("loss", "duplicate", "reorder"):
            check_number(f"NetworkQuality: {name}", getattr(self, name), 1.0)
        for name in ("delay_s", "jitter_s"):
            check_number(f"NetworkQuality: {name}", getattr(self, name))

    def knobs(self) -> NetworkKnobs:
        """Return the same quality in the simulator's units."""
        return NetworkKnobs(
            LinkKnobs(
                delay_us=round(self.delay_s * MICRO),
                jitter_us=round(self.jitter_s * MICRO),
                loss_permille=round(self.loss * 1_000),
                duplicate_permille=round(self.duplicate * 1_000),
                reorder_permille=round(self.reorder * 1_000),
            )
        )


@dataclass(frozen=True, slots=True)
class Failure:
    """A robot has failed at a local task. `reason` is its program's; empty if it gave none."""

    at_s: float
    robot: str
    local_task: str
    global_task: str
    reason: str


@dataclass(frozen=True, slots=True)
class ObservedFault:
    """A fault as the team saw it.

    `major`: a robot is dead. `minor`: it lost `local_tasks` for `reason`. `until_s` is None if the
    fault has not ended.
    """

    kind: Literal["major", "minor"]
    at_s: float
    robot: str
    local_tasks: tuple[str, ...] = ()
    reason: str = ""
    until_s: float | None = None


@dataclass(frozen=True, slots=True)
class Refused:
    """A command that had no effect, when it was given, and why.

    Robots have refused it, or too few of them were there. A `Restart` is refused if the mission in
    force does not have the robot.
    """

    at_s: float
    command: Command | Restart
    reason: str


@dataclass(frozen=True, slots=True)
class Event:
    """A robot's program began a local task, or ended it.

    `at_s` is in seconds from the launch of the team. `local_task` is ground: `carry(red)`.
    `outcome` is None at a start; success, failure or cancelled at an end.
    """

    at_s: float
    robot: str
    local_task: str
    global_task: str
    outcome: str | None = None


@dataclass(frozen=True)
class MissionRun:
    """The result of a run of `mission`.

    `result`: success, failure, timeout or blocked. `summary` is what `sim run --json` prints.
    `starts` and `ends` are in the order of time; if a robot was killed at work, that work has no
    end. `jobs` are those that the team has accepted, in the order of their submission, with the
    ends of at least the last 500. `refused` are commands that had no effect. `whole` is everything
    that the simulator reports. `revisions` are the missions of the commands.
    """

    result: str
    summary: Mapping[str, Any]
    starts: Sequence[Event]
    ends: Sequence[Event]
    jobs: Sequence[JobResult]
    refused: Sequence[Refused]
    whole: SimulationResult
    mission: Mission
    revisions: Sequence[Mission]

    @property
    def duration_s(self) -> float:
        """Virtual seconds from the first robot's joining to the result."""
        return float(self.summary["duration_s"] or 0.0)

    @property
    def failures(self) -> Sequence[Failure]:
        """The failures of local tasks, in order."""
        return [Failure(**each) for each in self.summary["failures"]]

    @property
    def faults(self) -> Sequence[ObservedFault]:
        """The faults that the team has seen, in order."""
        return [
            ObservedFault(**{**each, "local_tasks": tuple(each.get("local_tasks", ()))})
            for each in self.summary["faults"]
        ]

    def started(self, local_task: str | None = None) -> list[str]:
        """Return the robots that began a local task (ground, or a type; None: any), in order.

        This and the next three raise InputError for a local task that the mission never requests.
        """
        return self._robots(self.starts, local_task, None)

    def succeeded(self, local_task: str | None = None) -> list[str]:
        """Return the robots that ended it with success, in order."""
        return self._robots(self.ends, local_task, "success")

    def failed(self, local_task: str | None = None) -> list[str]:
        """Return the robots that ended it with failure, in order."""
        return self._robots(self.ends, local_task, "failure")

    def cancelled(self, local_task: str | None = None) -> list[str]:
        """Return the robots whose work on it was cancelled, in order."""
        return self._robots(self.ends, local_task, "cancelled")

    def _robots(
        self, events: Sequence[Event], local_task: str | None, outcome: str | None
    ) -> list[str]:
        if local_task is not None:
            local_task = local_task.replace(" ", "")
            missions = (self.mission, *self.revisions)
            if not any(is_local_task(each, local_task) for each in missions):
                known = set[str]().union(*map(local_task_names, missions))
                raise InputError(f"no local task {local_task!r}{nearest(local_task, known)}")
        return [
            event.robot
            for event in events
            if event.outcome == outcome
            and local_task in (None, event.local_task, type_name(event.local_task))
        ]

    def status(self, global_task: str) -> str:
        """Return the status of a global task: idle, running, success, failure or cancelled.

        Raises InputError for an unknown one.
        """
        known: Mapping[str, Any] = self.summary["global_tasks"]
        if global_task not in known:
            raise InputError(f"no global task {global_task!r}{nearest(global_task, known)}")
        return str(known[global_task]["status"])

    def job(self, job_id: str) -> JobResult:
        """Return the result of a job; raises InputError for one that the team has not accepted."""
        found = {job.id: job for job in self.jobs}
        if job_id not in found:
            why = next((r.reason for r in self.refused if _submits(r.command, job_id)), "")
            hint = f": {why}" if why else nearest(job_id, found)
            raise InputError(f"the team has taken no job {job_id!r}{hint}")
        return found[job_id]


def run(
    mission: File | Mission,
    program: RobotProgram | str | None = None,
    *,
    robots: Iterable[str] | None = None,
    faults: Iterable[tuple[float, Fault]] = (),
    commands: Iterable[tuple[float, Command]] = (),
    may_refuse: bool = False,
    until_jobs_end: bool = False,
    parameters: Mapping[str, Any] | None = None,
    network: NetworkQuality | None = None,
    seed: int = 0,
    speed: float = 1.0,
    timeout_s: float = 600.0,
) -> MissionRun:
    """Run a mission once in virtual time.

    `program` is the robots' program, or where one is; None: the mission's. `robots` take part, by
    default all. `faults` are (seconds from the launch, fault); each has to come before the run
    ends, and so does each of the `commands`, which are given by operators. Commands of the same
    time follow its faults, in their order. Each goes to all robots that live then, and is repeated
    for up to 10 s while these cannot accept it yet. `may_refuse`: commands may have no effect.
    `until_jobs_end`: the run ends when all submitted jobs have ended. `parameters` replace those
    that programs read; the tree stays as in the file. The same arguments give the same run; another
    `seed` gives other delays.

    Raises InputError for arguments that do not fit the mission. Raises AssertionError if one of the
    promises of docs/explanation/guarantees.md did not hold, or if a command had no effect without
    `may_refuse`.
    """
    check_number("speed", speed)
    check_number("timeout_s", timeout_s)
    loaded = mission if isinstance(mission, Mission) else load_mission(Path(fspath(mission)))
    for name in parameters or ():
        if name not in loaded.parameters:
            hint = nearest(name, loaded.parameters)
            raise InputError(f"mission {loaded.name} has no parameter {name!r}{hint}")
    team = _team(loaded, robots)
    missions = Missions(loaded)
    orders = read_commands(missions, commands, parameters)
    if until_jobs_end and not any(isinstance(each.given, Submit) for each in orders):
        raise InputError("until_jobs_end: no job is submitted; add a Submit to the commands")
    schedule = sorted([*_schedule(missions, faults), *orders], key=lambda named: named.at_us)
    check_faults(schedule, team, timeout_s)
    if parameters is not None:
        loaded = replace(loaded, parameters={**loaded.parameters, **parameters})
    found = program if isinstance(program, RobotProgram) else _load(loaded, program)
    require_program(
        found,
        "the program",
        loaded,
        {robot.id: robot.capabilities for robot in loaded.robots.values()},
    )
    functions_of(found).check_computer()
    recorded = copy.copy(found)
    recorded.record_work = True
    try:
        result = simulate(
            loaded,
            recorded,
            seed=seed,
            robots=team,
            schedule=[(each.at_us, each.fault) for each in schedule],
            network=None if network is None else network.knobs(),
            timeout_us=round(timeout_s * MICRO),
            speed=speed,
            until_jobs_end=until_jobs_end,
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    if too_late := list(missed(schedule, result.duration_us)):
        raise InputError("\n".join(too_late))
    assert not result.violations, "\n".join(result.violations)
    refused = list(_refused(result, schedule))
    if refused and not may_refuse:
        raise AssertionError("\n".join(said for said, _ in refused))
    events = list(_of_work(result.events))
    return MissionRun(
        result.result,
        result.summary,
        [event for event in events if event.outcome is None],
        [event for event in events if event.outcome is not None],
        job_results(result.observer, orders),
        [each for _, each in refused],
        result,
        loaded,
        missions.revisions(),
    )


def _refused(
    result: SimulationResult, schedule: Iterable[NamedFault]
) -> Iterator[tuple[str, Refused]]:
    """Yield the refused commands, each after a text for people."""
    named = {(each.at_us, id(each.fault)): each for each in schedule}
    for refusal in result.refusals:
        found, reason = named[refusal.at_us, id(refusal.step)], refusal.reason
        given = found.given if isinstance(found, NamedCommand) else found.fault
        assert isinstance(given, Command | Restart)
        yield f"{found.said}: {reason}", Refused(refusal.at_us / MICRO, given, reason)


def _submits(command: Command | Restart, job_id: str) -> bool:
    return isinstance(command, Submit) and command.id == job_id


def _team(mission: Mission, robots: Iterable[str] | None) -> list[str]:
    if robots is None:
        return sorted(mission.robots)
    if isinstance(robots, str):
        raise InputError(f"robots: a list of names is expected, e.g. [{robots!r}]")
    team = list(robots)
    for robot in team:
        check_robot(mission, robot, "robots")
        if team.count(robot) > 1:
            raise InputError(f"robots: {robot} is named twice")
    return sorted(team)


def _schedule(missions: Missions, faults: Iterable[tuple[float, Fault]]) -> list[NamedFault]:
    """Return the faults by time; raises InputError for one that does not fit the mission."""
    found = []
    for at_us, fault, said in timed("fault", faults, Fault, "(2.5, Kill('A1'))"):
        mission = missions.with_robot(fault.robot, at_us, said)
        if isinstance(fault, Lose | Restore | Perform):
            _check_local_task(mission, fault, said)
        if isinstance(fault, Perform):
            try:
                micro = micro_performance(fault.performance)
            except ValueError as error:
                raise InputError(f"{said}: {error}") from None
            given = ChangePerformance(fault.robot, fault.local_task, micro)
            found.append(NamedFault(at_us, given, said))
        else:
            found.append(NamedFault(at_us, fault, said))
    return sorted(found, key=lambda named: named.at_us)


def _check_local_task(mission: Mission, fault: Lose | Restore | Perform, said: str) -> None:
    if isinstance(fault, Perform) and fault.local_task == ALL:
        raise InputError(f"{said}: a performance is that of one local task")
    check_local_task(mission, fault.robot, fault.local_task, said)


def _load(mission: Mission, reference: str | None) -> RobotProgram:
    reference = reference or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one")
    return load_program(reference)


# The outcome of an event in the programs' record; None: that of the event.
_OUTCOMES = {"start": None, "begin": None, "end": None, "cancel": "cancelled"}


def _of_work(lines: Iterable[Mapping[str, Any]]) -> Iterator[Event]:
    """Yield the events of local tasks themselves, without the ways to their places."""
    on_the_way = set()
    for line in lines:
        if line.get("event") not in _OUTCOMES:
            continue
        process, is_way = (line["robot"], line["pid"]), "place" in line
        ends = line["event"] in ("end", "cancel")
        if not is_way and not (ends and process in on_the_way):
            yield _event(line)
        on_the_way.discard(process)
        if is_way:
            on_the_way.add(process)


def _event(line: Mapping[str, Any]) -> Event:
    return Event(
        line["t"],
        line["robot"],
        call_text(line["local_task"], line["args"]),
        line["global_task"],
        _OUTCOMES[line["event"]] or line["outcome"],
    )


class RunMission(Protocol):
    """The type of the fixture `run_mission`: `run`, with files relative to the test."""

    def __call__(
        self,
        mission: File,
        program: RobotProgram | str | None = None,
        *,
        robots: Iterable[str] | None = None,
        faults: Iterable[tuple[float, Fault]] = (),
        commands: Iterable[tuple[float, Command]] = (),
        may_refuse: bool = False,
        until_jobs_end: bool = False,
        parameters: Mapping[str, Any] | None = None,
        network: NetworkQuality | None = None,
        seed: int = 0,
        speed: float = 1.0,
        timeout_s: float = 600.0,
    ) -> MissionRun: ...
