"""Teams whose robots solve the assignment problem in different ways, or wrongly, still agree."""

from __future__ import annotations

import functools
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.assignment.problem import AssignmentProblem, Solver, SolverError
from mrbt_mesh.core.assignment.solvers import cp_sat, min_cost_flow
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.drills.physical import Span, spans
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime.program import RobotProgram, TaskContext
from mrbt_mesh.sim import AgentOptions, SimulationResult, simulate
from mrbt_mesh.sim.world import faults as f
from tests.support.effort import at_size
from tests.support.oracle import brute_force
from tests.support.runs import example

SECOND_US = 1_000_000
SCHEDULE = ((5 * SECOND_US, f.Kill("C2")), (9 * SECOND_US, f.Restart("C2")))


def backwards(problem: AssignmentProblem) -> Any:
    """Another optimum where there are several: that of the demands in the opposite order."""
    last = len(problem.demands) - 1
    rows = [{last - d: p for d, p in row.items()} for row in problem.performance]
    found = min_cost_flow(AssignmentProblem.of(problem.robots, problem.demands[::-1], rows))
    return None if found is None else [last - d if d >= 0 else d for d in found.tolist()]


def story(result: SimulationResult) -> tuple[Any, ...]:
    """What was done and when, and the last plans."""
    plans = {
        robot: agent.view.plan.packed for robot, agent in result.agents.items() if agent.view.plan
    }
    return result.result, result.duration_us, result.events, plans


@pytest.mark.slow
@pytest.mark.parametrize("schedule", at_size(quick=[SCHEDULE], gate=[SCHEDULE, ()]))
def test_robots_with_different_solvers_make_the_same_plans(schedule: Any) -> None:
    mission, program = example("vehicle_repair")
    solvers: dict[str, Solver] = {
        "A1": cp_sat,
        "A2": brute_force,
        "B1": min_cost_flow,
        "B2": backwards,
    }
    plain = simulate(mission, program, seed=3, schedule=schedule)
    mixed = simulate(
        mission, program, seed=3, schedule=schedule, agents=AgentOptions(solvers=solvers)
    )
    # I1: equal facts, equal plan, to the byte; I7: each the canonical optimum.
    assert mixed.violations == []
    assert mixed.checks["I1"] >= 10
    assert mixed.checks["I7"] >= 1
    assert mixed.result == "success"
    assert story(mixed) == story(plain)


def _raises(problem: AssignmentProblem) -> Any:
    raise RuntimeError("out of order")


def _refuses(problem: AssignmentProblem) -> Any:
    raise SolverError("too large for me")


BROKEN: dict[str, tuple[Solver, str]] = {
    "raises": (_raises, "it raised RuntimeError: out of order"),
    "refuses": (_refuses, "too large for me"),
    "finds nothing": (lambda problem: None, "it finds no assignment, but there is one"),
    "leaves all idle": (lambda problem: [-1] * len(problem.robots), "0 robots on "),
    "returns nonsense": (lambda problem: "nonsense", "one whole number per robot"),  # type: ignore
    "one too many": (lambda problem: [-1] * (len(problem.robots) + 1), "answers for "),
}


@functools.cache
def plain_repair() -> SimulationResult:
    """The repair by robots with the default solver."""
    mission, program = example("vehicle_repair")
    return simulate(mission, program, seed=3, inspect=False)


@pytest.mark.slow
@pytest.mark.parametrize("kind", at_size(quick=list(BROKEN)[:3], gate=list(BROKEN)))
def test_a_robot_with_a_broken_solver_plans_as_the_others_and_says_so_once(kind: str) -> None:
    solver, reason = BROKEN[kind]
    mission, program = example("vehicle_repair")
    result = simulate(
        mission, program, seed=3, agents=AgentOptions(solvers={"B1": solver}), keep_log=True
    )
    assert result.violations == []
    assert story(result) == story(plain_repair())
    (line,) = [line for line in result.effect_log if "solver_failed" in line]
    assert " B1 " in line
    assert reason in line
    count = result.agents["B1"].view.refused["solver: broke its contract"]
    assert count > 5
    assert "solver: broke its contract" not in result.agents["A1"].view.refused


def test_nor_does_it_matter_where_robots_plan_together() -> None:
    mission, program = example("vehicle_repair")
    plain = plain_repair()
    for broken in (dict.fromkeys(mission.robots, _raises), {"A1": _raises}):
        result = simulate(
            mission, program, seed=3, agents=AgentOptions(solvers=broken), inspect=False
        )
        assert story(result) == story(plain)


# -- side constraints -------------------------------------------------------------------------

CARRY = """
mission: carry
local_tasks: {pick: {parameters: [item], work: 2}, place: {parameters: [item], work: 2}}
robot_types: {Arm: {capabilities: {pick: 1, place: 1}}}
robots: {R1: Arm, R2: Arm, R3: Arm, R4: Arm}
global_tasks:
  fetch: {parameters: [item], needs: {pick($item): {}}}
  bring:
    parameters: [item]
    needs: {place($item): {same_robot_as: {global_task: fetch($item)}}}
parameters: {items: [1, 2, 3, 4, 5]}
tree:
  Parallel:
    for_each: {item: $items}
    do: {Sequence: [fetch($item), bring($item)]}
"""
LIMITS = """
constraints:
  at_most: [{robots: [R1, R2, R3, R4], count: 3}, {robots: [R1, R2]}]
  not_at_once: [{global_tasks: [bring], count: 1}]
"""


@functools.cache
def program() -> RobotProgram:
    """Simulated work, as in the examples, for whatever is asked for."""
    _, known = example("explore")
    simulated = sys.modules["simulated"]
    assert known is not None
    made = RobotProgram(record_work=True)

    async def act(task: TaskContext, item: str) -> None:
        await simulated.work(task)

    for name in ("pick", "place"):
        made.local_task(name)(act)
    return made


def carry(text: str) -> Mission:
    return mission_from_yaml(text, "carry.yaml", Path("/nowhere"))


def at_work(result: SimulationResult) -> list[Span]:
    """What was done; who was killed at 5 s did no more."""
    found = spans(result.events)
    return [span if span.end else replace(span, end_s=5.0) for span in found]


KILLS = [((5 * SECOND_US, f.Kill("R3")),), ()]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1))
@pytest.mark.parametrize("kills", at_size(quick=KILLS[:1], gate=KILLS))
def test_a_team_keeps_its_side_constraints_all_the_time(seed: int, kills: Any) -> None:
    mission = carry(CARRY + LIMITS)
    solvers: dict[str, Solver] = {"R2": brute_force, "R4": cp_sat}
    result = simulate(
        mission, program(), seed=seed, agents=AgentOptions(solvers=solvers), schedule=kills
    )
    assert result.violations == [], f"seed {seed}"
    assert result.checks["I1"] > 0
    found = at_work(result)
    if not kills:
        assert result.result == "success"
        assert len(found) == 10
    for start in sorted(span.start_s for span in found):
        now = [span for span in found if span.start_s <= start < span.end_s]
        assert len(now) <= 3, f"seed {seed}: {now}"
        assert sum(span.robot in ("R1", "R2") for span in now) <= 1, f"seed {seed}: {now}"
        assert sum(span.local_task == "place" for span in now) <= 1, f"seed {seed}: {now}"
    picked = {span.part: span.robot for span in found if span.local_task == "pick"}
    for span in found:
        if span.local_task == "place":
            assert picked[span.part] == span.robot, f"seed {seed}: {span}"


def test_without_them_more_is_done_at_once() -> None:
    found = at_work(simulate(carry(CARRY), program(), seed=0))
    most = max(sum(s.start_s <= each.start_s < s.end_s for s in found) for each in found)
    assert most == 4
