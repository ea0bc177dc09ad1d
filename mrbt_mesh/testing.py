"""Tests of a mission with its robots' own programs, in virtual time, with faults.

    from mrbt_mesh.testing import Kill

    def test_the_other_porter_takes_over(run_mission):      # a fixture of pytest
        run = run_mission("mission.yaml", faults=[(5.0, Kill("P1"))])
        assert run.result == "success"
        assert run.succeeded("carry(red)") == ["P2"]

A run of minutes takes milliseconds, and is the same each time. Programs wait with `anyio.sleep` or
`asyncio.sleep`; what they do apart from the event loop takes no virtual time.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias

from mrbt_mesh.core.mission.mission import MICRO, Mission, micro_performance
from mrbt_mesh.core.mission.names import ALL, type_name
from mrbt_mesh.errors import InputError, nearest
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
    check_robot,
    local_task_names,
    missed,
)

__all__ = [
    "Event",
    "Failure",
    "Fault",
    "Freeze",
    "Kill",
    "Leave",
    "Lose",
    "MissionRun",
    "NetworkQuality",
    "ObservedFault",
    "Perform",
    "Restart",
    "Restore",
    "RunMission",
    "Thaw",
    "run",
]

File: TypeAlias = "str | PathLike[str]"


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
            _number(f"NetworkQuality: {name}", getattr(self, name), 1.0)
        for name in ("delay_s", "jitter_s"):
            _number(f"NetworkQuality: {name}", getattr(self, name))

    def knobs(self) -> NetworkKnobs:
        """The same in the simulator's units."""
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
    """A robot has failed at a local task. `reason`: that of its program, empty if it gave none."""

    at_s: float
    robot: str
    local_task: str
    global_task: str
    reason: str


@dataclass(frozen=True, slots=True)
class ObservedFault:
    """A fault as the team has seen it: `major`, a robot is dead; `minor`, it lost `local_tasks`
    for `reason`.

    `until_s` is None if it has not ended.
    """

    kind: Literal["major", "minor"]
    at_s: float
    robot: str
    local_tasks: tuple[str, ...] = ()
    reason: str = ""
    until_s: float | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """What a robot's program did: it began a local task, or ended it.

    `at_s`: seconds from the launch of the team. `local_task` is ground: `carry(red)`. `outcome`:
    None at a start; success, failure or cancelled at an end.
    """

    at_s: float
    robot: str
    local_task: str
    global_task: str
    outcome: str | None = None


@dataclass(frozen=True)
class MissionRun:
    """What came of a run of `mission`.

    `result`: success, failure, timeout or blocked. `summary` is what `sim run --json` prints.
    `starts` and `ends` are in the order of time; a robot that was killed at work has no end of
    it. `whole` is all that the simulator reports.
    """

    result: str
    summary: Mapping[str, Any]
    starts: Sequence[Event]
    ends: Sequence[Event]
    whole: SimulationResult
    mission: Mission

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
        """The robots that began a local task (ground, or a type; None: any), in order.

        This and the next three raise InputError for a local task that the mission never asks for.
        """
        return self._robots(self.starts, local_task, None)

    def succeeded(self, local_task: str | None = None) -> list[str]:
        """The robots that ended it with success, in order."""
        return self._robots(self.ends, local_task, "success")

    def failed(self, local_task: str | None = None) -> list[str]:
        """The robots that ended it with failure, in order."""
        return self._robots(self.ends, local_task, "failure")

    def cancelled(self, local_task: str | None = None) -> list[str]:
        """The robots whose work on it was cancelled, in order."""
        return self._robots(self.ends, local_task, "cancelled")

    def _robots(
        self, events: Sequence[Event], local_task: str | None, outcome: str | None
    ) -> list[str]:
        if local_task is not None:
            local_task = local_task.replace(" ", "")
            known = local_task_names(self.mission)
            if local_task not in known:
                raise InputError(f"no local task {local_task!r}{nearest(local_task, known)}")
        return [
            event.robot
            for event in events
            if event.outcome == outcome
            and local_task in (None, event.local_task, type_name(event.local_task))
        ]

    def status(self, global_task: str) -> str:
        """What became of a global task: idle, running, success, failure or cancelled."""
        known: Mapping[str, Any] = self.summary["global_tasks"]
        if global_task not in known:
            raise InputError(f"no global task {global_task!r}{nearest(global_task, known)}")
        return str(known[global_task]["status"])


def run(
    mission: File | Mission,
    program: RobotProgram | str | None = None,
    *,
    robots: Iterable[str] | None = None,
    faults: Iterable[tuple[float, Fault]] = (),
    parameters: Mapping[str, Any] | None = None,
    network: NetworkQuality | None = None,
    seed: int = 0,
    speed: float = 1.0,
    timeout_s: float = 600.0,
) -> MissionRun:
    """Run a mission once in virtual time.

    `program`: the robots' program, or where one is; None: the mission's. `robots`: those that take
    part, by default all. `faults`: (seconds from the launch, fault); each has to come before the
    run ends. `parameters` replace those that programs read; the tree is that of the file. The same
    arguments give the same run; another `seed` gives other delays.

    Raises InputError for what does not fit the mission, AssertionError where one of the promises of
    docs/explanation/guarantees.md did not hold.
    """
    _number("speed", speed)
    _number("timeout_s", timeout_s)
    loaded = mission if isinstance(mission, Mission) else load_mission(Path(fspath(mission)))
    for name in parameters or ():
        if name not in loaded.parameters:
            hint = nearest(name, loaded.parameters)
            raise InputError(f"mission {loaded.name} has no parameter {name!r}{hint}")
    team = _team(loaded, robots)
    schedule = _schedule(loaded, faults)
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
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    if too_late := list(missed(schedule, result.duration_us)):
        raise InputError("\n".join(too_late))
    assert not result.violations, "\n".join(result.violations)
    events = list(_of_work(result.events))
    return MissionRun(
        result.result,
        result.summary,
        [event for event in events if event.outcome is None],
        [event for event in events if event.outcome is not None],
        result,
        loaded,
    )


def _team(mission: Mission, robots: Iterable[str] | None) -> list[str]:
    if robots is None:
        return sorted(mission.robots)
    if isinstance(robots, str):
        raise InputError(f"robots: a list of names is expected, e.g. [{robots!r}]")
    team = sorted(robots)
    for robot in team:
        check_robot(mission, robot, "robots")
    return team


def _schedule(mission: Mission, faults: Iterable[tuple[float, Fault]]) -> list[NamedFault]:
    """The faults by time; raises InputError for what is no fault of this mission's robots."""
    found = []
    for index, entry in enumerate(faults):
        place = f"faults[{index}]"
        if not isinstance(entry, tuple) or len(entry) != 2 or not isinstance(entry[1], Fault):
            text = "(seconds, fault) is expected, e.g. (2.5, Kill('A1'))"
            raise InputError(f"{place}: {text}, found {entry!r:.80}")
        at_s, fault = entry
        _number(f"{place}: seconds", at_s)
        said = f"{place}: {fault!r} at {at_s:g} s"
        check_robot(mission, fault.robot, said)
        if isinstance(fault, Lose | Restore | Perform):
            _check_local_task(mission, fault, said)
        if isinstance(fault, Perform):
            try:
                micro = micro_performance(fault.performance)
            except ValueError as error:
                raise InputError(f"{said}: {error}") from None
            given = ChangePerformance(fault.robot, fault.local_task, micro)
            found.append(NamedFault(round(at_s * MICRO), given, said))
        else:
            found.append(NamedFault(round(at_s * MICRO), fault, said))
    return sorted(found, key=lambda named: named.at_us)


def _check_local_task(mission: Mission, fault: Lose | Restore | Perform, said: str) -> None:
    if isinstance(fault, Perform) and fault.local_task == ALL:
        raise InputError(f"{said}: a performance is that of one local task")
    check_local_task(mission, fault.robot, fault.local_task, said)


def _number(name: str, value: Any, most: float = math.inf) -> None:
    """Raise InputError unless it is a finite number from 0 to `most`."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or not 0 <= value <= most:
        limit = "" if most == math.inf else f" to {most:g}"
        raise InputError(f"{name}: a number from 0{limit} is expected, not {value!r:.80}")


def _load(mission: Mission, reference: str | None) -> RobotProgram:
    reference = reference or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one")
    return load_program(reference)


# The outcome of an event of the programs' record; None: that of the event.
_OUTCOMES = {"start": None, "begin": None, "end": None, "cancel": "cancelled"}


def _of_work(lines: Iterable[Mapping[str, Any]]) -> Iterator[Event]:
    """What the lines say of local tasks themselves, not of ways to their places."""
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
    """What the fixture `run_mission` gives: `run`, with files beside the test."""

    def __call__(
        self,
        mission: File,
        program: RobotProgram | str | None = None,
        *,
        robots: Iterable[str] | None = None,
        faults: Iterable[tuple[float, Fault]] = (),
        parameters: Mapping[str, Any] | None = None,
        network: NetworkQuality | None = None,
        seed: int = 0,
        speed: float = 1.0,
        timeout_s: float = 600.0,
    ) -> MissionRun: ...
