"""Runs of the examples in virtual time, for tests. Every failure names its seed."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any, Protocol

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.drills.physical import Span, spans
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import AgentOptions, NetworkKnobs, Schedule, SimulationResult, simulate
from mrbt_mesh.sim.chaos.campaign import Source
from tests.support.paths import EXAMPLES


@functools.cache
def example(name: str) -> tuple[Mission, RobotProgram]:
    """An example's mission and its robots' program."""
    mission = load_mission(EXAMPLES / name / "mission.yaml")
    assert mission.program is not None
    return mission, load_program(mission.program)


def source(name: str | None) -> Source:
    """The missions of an example, or generated ones."""
    if name is None:
        return Source()
    path = EXAMPLES / name / "mission.yaml"
    return Source(str(path), load_mission(path).program, speed=2.0)


class Run(Protocol):
    def __call__(
        self,
        name: str,
        seed: int,
        *,
        expect: str | None = "success",
        schedule: Schedule = (),
        network: NetworkKnobs | None = None,
        robots: Iterable[str] | None = None,
        timeout_us: int = 120_000_000,
        speed: float = 1.0,
        plan_delay_us: int | None = None,
        keep_log: bool = False,
        parameters: dict[str, Any] | None = None,
    ) -> SimulationResult: ...


@functools.cache
def undisturbed(seed: int) -> tuple[Span, ...]:
    """What the robots do in vehicle_repair when nothing goes wrong; computed once per seed."""
    result = run_example("vehicle_repair", seed)
    return tuple(spans(result.events))


def run_example(
    name: str,
    seed: int,
    *,
    expect: str | None = "success",
    schedule: Schedule = (),
    network: NetworkKnobs | None = None,
    robots: Iterable[str] | None = None,
    timeout_us: int = 120_000_000,
    speed: float = 1.0,
    plan_delay_us: int | None = None,
    keep_log: bool = False,
    parameters: dict[str, Any] | None = None,
) -> SimulationResult:
    """Simulate an example; no invariant may break on the way, and the result is as expected."""
    mission, program = example(name)
    if parameters:
        values = {**mission.parameters, **parameters}
        mission = Mission(**{**_fields(mission), "parameters": values})
    steps = list(schedule)
    result = simulate(
        mission,
        program,
        seed=seed,
        schedule=steps,
        network=network,
        robots=robots,
        timeout_us=timeout_us,
        speed=speed,
        agents=AgentOptions(plan_delay_us=plan_delay_us),
        keep_log=keep_log,
    )
    where = f"seed {seed}, schedule {steps}, network {network}, speed {speed}"
    assert not result.violations, f"{where}: {result.violations}"
    if expect is not None:
        assert result.result == expect, f"{where}: {result.result} {result.summary['blocked']}"
    return result


def _fields(mission: Mission) -> dict[str, Any]:
    return {name: getattr(mission, name) for name in mission.__dataclass_fields__}
