"""Runs of the examples in virtual time, for tests. Every failure names its seed."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.drills.physical import Span, spans
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import AgentOptions, Schedule, SimulationResult, simulate
from mrbt_mesh.sim.chaos.campaign import Source
from tests.support.paths import mission_file

# `run_example`, or one that is like it.
Run = Callable[..., SimulationResult]


@functools.cache
def example(name: str) -> tuple[Mission, RobotProgram]:
    """An example's mission and its robots' program."""
    mission = load_mission(mission_file(name))
    assert mission.program is not None
    return mission, load_program(mission.program)


def source(name: str | None) -> Source:
    """The missions of an example, or generated ones."""
    if name is None:
        return Source()
    path = mission_file(name)
    return Source(str(path), load_mission(path).program, speed=2.0)


@functools.cache
def undisturbed(seed: int) -> tuple[Span, ...]:
    """The robots' work in vehicle_repair without a fault; computed once per seed."""
    result = run_example("vehicle_repair", seed)
    return tuple(spans(result.events))


def run_example(
    name: str,
    seed: int,
    *,
    expect: str | None = "success",
    schedule: Schedule = (),
    timeout_us: int = 120_000_000,
    plan_delay_us: int | None = None,
    parameters: Mapping[str, Any] | None = None,
    **options: Any,
) -> SimulationResult:
    """Simulate an example; no invariant may break on the way, and the result is as expected.

    `options`: more for `simulate`.
    """
    mission, program = example(name)
    if parameters:
        mission = replace(mission, parameters={**mission.parameters, **parameters})
    result = simulate(
        mission,
        program,
        seed=seed,
        schedule=list(schedule),
        timeout_us=timeout_us,
        agents=AgentOptions(plan_delay_us=plan_delay_us),
        **options,
    )
    where = f"seed {seed}, schedule {list(schedule)}, {options}"
    assert not result.violations, f"{where}: {result.violations}"
    if expect is not None:
        assert result.result == expect, f"{where}: {result.result} {result.summary['blocked']}"
    return result
