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

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.expand import call_text
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program, require_program
from mrbt_mesh.sim import (
    Fault,
    Freeze,
    Kill,
    Leave,
    LinkKnobs,
    Lose,
    NetworkKnobs,
    Perform,
    Restart,
    Restore,
    SimulationResult,
    Thaw,
    simulate,
)

__all__ = [
    "Event",
    "Fault",
    "Freeze",
    "Kill",
    "Leave",
    "LinkKnobs",
    "Lose",
    "MissionRun",
    "NetworkKnobs",
    "Perform",
    "Restart",
    "Restore",
    "RunMission",
    "Thaw",
    "run",
]

File: TypeAlias = "str | PathLike[str]"


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
    """What came of a run.

    `result`: success, failure, timeout or blocked. `summary` is that of `mrbt sim --json`. `starts`
    and `ends` are in the order of time; a robot that was killed at work has no end of it. `whole`
    is all that the simulator tells.
    """

    result: str
    summary: Mapping[str, Any]
    starts: Sequence[Event]
    ends: Sequence[Event]
    whole: SimulationResult

    @property
    def duration_s(self) -> float:
        """Virtual seconds from the first robot's joining to the result."""
        return float(self.summary["duration_s"] or 0.0)

    @property
    def failures(self) -> Sequence[Mapping[str, Any]]:
        """Who failed at what, when and why: `robot`, `local_task`, `reason`, ..."""
        failures: Sequence[Mapping[str, Any]] = self.summary["failures"]
        return failures

    def started(self, local_task: str | None = None) -> list[str]:
        """Who began a local task (ground, or a type; None: any), in order."""
        return [event.robot for event in self.starts if _is_of(event, local_task)]

    def succeeded(self, local_task: str | None = None) -> list[str]:
        """Who ended it with success, in order."""
        return self._ended(local_task, "success")

    def failed(self, local_task: str | None = None) -> list[str]:
        """Who ended it with failure, in order."""
        return self._ended(local_task, "failure")

    def cancelled(self, local_task: str | None = None) -> list[str]:
        """Whose work on it was cancelled, in order."""
        return self._ended(local_task, "cancelled")

    def _ended(self, local_task: str | None, outcome: str) -> list[str]:
        found = (event for event in self.ends if event.outcome == outcome)
        return [event.robot for event in found if _is_of(event, local_task)]

    def status(self, global_task: str) -> str:
        """What became of a global task: idle, running, success, failure or cancelled."""
        known: Mapping[str, Any] = self.summary["global_tasks"]
        if global_task not in known:
            raise InputError(f"no global task {global_task!r}; there are {', '.join(known)}")
        return str(known[global_task]["status"])


def _is_of(event: Event, local_task: str | None) -> bool:
    return local_task in (None, event.local_task, type_name(event.local_task))


def run(
    mission: File | Mission,
    program: RobotProgram | str | None = None,
    *,
    robots: Iterable[str] | None = None,
    faults: Iterable[tuple[float, Fault]] = (),
    parameters: Mapping[str, Any] | None = None,
    network: NetworkKnobs | None = None,
    seed: int = 0,
    speed: float = 1.0,
    timeout_s: float = 600.0,
) -> MissionRun:
    """Run a mission once in virtual time.

    `program`: the robots' program, or where one is; None: the mission's. `robots`: those that take
    part, by default all. `faults`: (seconds from the launch, fault). `parameters` replace those
    that programs read; the tree is that of the file. The same arguments give the same run; another
    `seed` gives other delays.

    Raises InputError for what does not fit the mission, AssertionError where one of the promises of
    docs/guarantees.md did not hold.
    """
    loaded = mission if isinstance(mission, Mission) else load_mission(Path(fspath(mission)))
    if parameters is not None:
        loaded = replace(loaded, parameters={**loaded.parameters, **parameters})
    found = program if isinstance(program, RobotProgram) else _load(loaded, program)
    require_program(
        found,
        "the program",
        loaded,
        {robot.id: robot.capabilities for robot in loaded.robots.values()},
    )
    found.check_computer()
    schedule = sorted(
        ((round(at_s * MICRO), fault) for at_s, fault in faults), key=lambda step: step[0]
    )
    try:
        result = simulate(
            loaded,
            found.recorded(),
            seed=seed,
            robots=robots,
            schedule=schedule,
            network=network,
            timeout_us=round(timeout_s * MICRO),
            speed=speed,
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    assert not result.violations, "\n".join(result.violations)
    events = [_event(line) for line in result.events if line.get("event") in _OUTCOMES]
    return MissionRun(
        result.result,
        result.summary,
        [event for event in events if event.outcome is None],
        [event for event in events if event.outcome is not None],
        result,
    )


def _load(mission: Mission, reference: str | None) -> RobotProgram:
    reference = reference or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one")
    return load_program(reference)


# What an event of the programs' record says of the outcome; None: its own word.
_OUTCOMES = {"start": None, "end": None, "cancel": "cancelled"}


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
        self, mission: File, program: RobotProgram | str | None = None, **more: Any
    ) -> MissionRun: ...
