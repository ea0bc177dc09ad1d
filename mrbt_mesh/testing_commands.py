"""What operators do in a test of `mrbt_mesh.testing`: commands to a running team.

InputError is raised for a command that fits neither the mission nor an earlier revision. Whether
the team accepts a command is decided when it is given.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.features.contact.commands import Borrow, Return
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.observer.job_rows import HELD, RUNNING, WAITING, JobRows
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.runtime.job_requests import arguments_of, check_job, check_priority
from mrbt_mesh.sim.world.named_faults import NamedFault, check_number, check_robot
from mrbt_mesh.sim.world.team_commands import (
    AbortMission,
    CancelJob,
    HoldJob,
    PauseTeam,
    Propose,
    ReleaseJob,
    ResumeTeam,
    SetPriority,
    Submit,
    TeamCommand,
)

File: TypeAlias = "str | PathLike[str]"
_Step = TypeVar("_Step")


@dataclass(frozen=True, slots=True)
class ReviseMission:
    """Give the team another mission, as `mrbt revise` does.

    `force` and `repeat_exclusive` are its options. A mission that is not in force after 30 s is
    withdrawn.
    """

    mission: File | Mission
    force: bool = False
    repeat_exclusive: bool = False


ChangeOfJob: TypeAlias = CancelJob | HoldJob | ReleaseJob | SetPriority
Command: TypeAlias = (
    Submit | ChangeOfJob | ReviseMission | Borrow | Return | PauseTeam | ResumeTeam | AbortMission
)


@dataclass(frozen=True, slots=True)
class JobResult:
    """The result of a job.

    `state`: succeeded, failed, cancelled or expired; held, waiting or running if the run ended
    first. `arguments` are by parameter name. `why` tells what the job waits for, or why it has
    failed. `robots` worked on it. `begun_s`, `ended_s` are in seconds from the launch, None if it
    did not begin or end. `attempts` is how often its tree was begun. `results` are the values that
    its tasks set for its own entries of the blackboard.
    """

    id: str
    type: str
    arguments: Mapping[str, str | int]
    state: str
    why: str
    robots: tuple[str, ...]
    submitted_s: float
    begun_s: float | None
    ended_s: float | None
    attempts: int
    results: Mapping[str, str]


@dataclass(frozen=True)
class NamedCommand(NamedFault):
    """A command as it was `given`, with its form for the simulator."""

    given: Command


class Missions:
    """The missions that may be in force: the first one, and revisions once they are proposed."""

    def __init__(self, first: Mission) -> None:
        self._found = [(0, first)]

    def add(self, at_us: int, revision: Mission) -> None:
        """Add a revision that is proposed at this time."""
        self._found = sorted([*self._found, (at_us, revision)], key=lambda each: each[0])

    def revisions(self) -> list[Mission]:
        """Return all missions but the first, in order."""
        return [mission for _, mission in self._found[1:]]

    def at(self, at_us: int) -> list[Mission]:
        """Return the missions that may be in force at this time, the newest first."""
        return [mission for since_us, mission in reversed(self._found) if since_us <= at_us]

    def with_robot(self, robot: str, at_us: int, said: str) -> Mission:
        """Return the newest mission of that time with this robot; raises InputError if none has
        it.
        """
        missions = self.at(at_us)
        found = next((each for each in missions if robot in each.robots), missions[0])
        check_robot(found, robot, said)
        return found


def timed(
    what: str, given: Iterable[tuple[float, _Step]], kinds: Any, example: str
) -> Iterator[tuple[int, _Step, str]]:
    """Yield (time in us, step, how it was written); raises InputError for other kinds of steps."""
    for index, entry in enumerate(given):
        place = f"{what}s[{index}]"
        if not isinstance(entry, tuple) or len(entry) != 2 or not isinstance(entry[1], kinds):
            text = f"(seconds, {what}) is expected, e.g. {example}"
            raise InputError(f"{place}: {text}, found {entry!r:.80}")
        at_s, step = entry
        check_number(f"{place}: seconds", at_s)
        yield round(at_s * MICRO), step, f"{place}: {step!r:.200} at {at_s:g} s"


def read_commands(
    missions: Missions,
    given: Iterable[tuple[float, Command]],
    parameters: Mapping[str, Any] | None = None,
) -> list[NamedCommand]:
    """Return the commands by time, and add revisions to the `missions`.

    Revisions get the values of `parameters` that they declare.
    """
    entries = list(timed("command", given, Command, "(2.5, CancelJob('job-1'))"))
    proposed = {}
    for at_us, command, said in entries:
        if isinstance(command, ReviseMission):
            revision = _revision(command, said)
            known = {n: v for n, v in (parameters or {}).items() if n in revision.parameters}
            revision = replace(revision, parameters={**revision.parameters, **known})
            missions.add(at_us, revision)
            proposed[said] = revision
    named = {each.id for _, each, _ in entries if isinstance(each, Submit) and each.id}
    free = (name for n in count(1) if (name := f"job-{n}") not in named)
    found = []
    for at_us, command, said in entries:
        as_given, step = command, proposed.get(said)
        if isinstance(command, ReviseMission):
            assert step is not None
            sent: TeamCommand = Propose(step, command.force, command.repeat_exclusive)
        elif isinstance(command, Submit):
            as_given = sent = command if command.id else replace(command, id=next(free))
        else:
            sent = command
        found.append(NamedCommand(at_us, sent, said, as_given))
    found.sort(key=lambda each: each.at_us)
    jobs = [each.fault.id for each in found if isinstance(each.fault, Submit)]
    for each in found:
        _check(each, missions, jobs)
    return found


def _revision(command: ReviseMission, said: str) -> Mission:
    if isinstance(command.mission, Mission):
        return command.mission
    if not isinstance(command.mission, str | PathLike):
        raise InputError(f"{said}: a mission is a file, or what load_mission returns")
    return load_mission(Path(fspath(command.mission)))


def _check(named: NamedCommand, missions: Missions, jobs: Sequence[str]) -> None:
    """Raise InputError for a command that no team with these missions could accept."""
    said = named.said
    match named.given:
        case Submit() as job:
            for field in ("not_before_s", "deadline_s"):
                if getattr(job, field) is not None:
                    check_number(f"{said}: {field}", getattr(job, field))
            problems = [_problem(each, job) for each in missions.at(named.at_us)]
            if all(problems):
                raise InputError(f"{said}: {problems[0]}")
        case Borrow(robot) | Return(robot):
            missions.with_robot(robot, named.at_us, said)
        case CancelJob(job_id) | HoldJob(job_id) | ReleaseJob(job_id) | SetPriority(job_id):
            if job_id not in jobs:
                raise InputError(f"{said}: no job {job_id!r} is submitted{nearest(job_id, jobs)}")
            if isinstance(named.given, SetPriority):
                try:
                    check_priority(named.given.priority)
                except InputError as error:
                    raise InputError(f"{said}: {error}") from None


def _problem(mission: Mission, job: Submit) -> str:
    """Return why a team with this mission would refuse the job; empty if it would not."""
    try:
        arguments = arguments_of(mission, job.type, job.arguments)
        return check_job(mission, job.type, arguments, job.id, job.priority).problem(arguments)
    except InputError as error:
        return str(error)


def beside(folder: Path, given: Iterable[Any]) -> Iterator[Any]:
    """Yield the commands with paths relative to this folder."""
    for entry in given:
        match entry:
            case (at_s, ReviseMission(str() | PathLike() as file) as command):
                yield at_s, replace(command, mission=folder / file)
            case _:
                yield entry


def job_results(observer: Observer, commands: Iterable[NamedCommand]) -> list[JobResult]:
    """Return the submitted jobs that the team has accepted, in the order of submission."""
    rows = {row.id: row for row in JobRows().of(observer)}
    log = observer.record.job_log
    found = []
    ids = [each.fault.id for each in commands if isinstance(each.fault, Submit)]
    for name in dict.fromkeys(ids):
        if name not in rows:
            continue
        row, history = rows[name], log.jobs[name]
        submitted_us = history.submitted_us
        is_open = row.state in (HELD, WAITING, RUNNING)
        found.append(
            JobResult(
                id=name,
                type=row.type,
                arguments=row.arguments,
                state=row.state,
                why=row.why,
                robots=row.robots,
                submitted_s=(submitted_us or 0) / MICRO,
                begun_s=_seconds(history.begun_us),
                ended_s=_seconds(None if is_open else log.ended_us(history)),
                attempts=history.attempts,
                results=dict(history.results),
            )
        )
    return found


def _seconds(at_us: int | None) -> float | None:
    return None if at_us is None else at_us / MICRO
