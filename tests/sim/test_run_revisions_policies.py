"""A revision changes the policies of a task that robots work on: what they wrote under the ones
before is read under the others.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import TaskContext
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim import Fault, Kill, Restart, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Operate, Revise

S = 1_000_000
FILE = """
mission: changing
ends: never
conditions: {wet: {default: false}, go: {default: true}}
local_tasks: {w: {parameters: [x], work: 4}, v: {parameters: [x], work: 4}}
robot_types: {r: {capabilities: {w: 1, v: 1}}}
robots: {R1: r, R2: r, R3: r}
global_tasks:
  t: {parameters: [x], needs: {w($x): {min: %d}}%s}
  u: {parameters: [x], needs: {v($x): {}}}
"""
TEAM = "tree: {Parallel: {success: all, children: [t(s1), u(s2)]}}\n"
JOBS = """jobs: {k: {parameters: {p: [a, b]}, tree: {Sequence: [t($p), u($p)]}}}
tree: {Jobs: [k]}
"""
POLICIES = {
    "plain": "",
    "exclusive": ", exclusive: true",
    "simultaneous": ", simultaneous: true",
    "preemptive": ", preemptive: true",
}


def mission(policy: str, tree: str, robots: int) -> Mission:
    text = FILE % (robots, POLICIES[policy]) + tree
    return mission_from_yaml(text, "it.yaml", Path())


def run(first: Mission, *faults: tuple[float, Fault], seconds: float = 40) -> SimulationResult:
    """Each task sets a condition as it ends, so that its outcome comes with what follows."""
    program = RobotProgram()

    async def work(task: TaskContext, *arguments: str) -> None:
        task.record_event({"began": f"{task.local_task}", "robot": task.robot})
        try:
            await anyio.sleep(task.simulation.duration_s)
        except anyio.get_cancelled_exc_class():
            task.set_condition("wet", True)
            raise
        task.set_condition("wet", True)
        task.record_event({"done": f"{task.local_task}", "robot": task.robot})

    program.local_task("*")(work)
    schedule = [(round(at_s * S), fault) for at_s, fault in sorted(faults, key=lambda f: f[0])]
    result = simulate(first, program, seed=1, schedule=schedule, timeout_us=round(seconds * S))
    violations = [v for v in result.violations if "I6" not in str(v)]
    assert not violations, violations
    return result


CHANGES = list(itertools.permutations(POLICIES, 2))


@pytest.mark.parametrize(("before", "after"), CHANGES, ids=map("-".join, CHANGES))
@pytest.mark.parametrize("tree", [TEAM, JOBS], ids=["team", "job"])
@pytest.mark.parametrize(
    "at_s", [pytest.param(2.3, marks=pytest.mark.slow), 4.0], ids=["getting ready", "running"]
)
def test_the_policies_of_a_task_under_way_change(
    before: str, after: str, tree: str, at_s: float
) -> None:
    """It is cancelled and begun by the others; after the way back too; a robot starts anew."""
    robots = 2 if "simultaneous" in (before, after) else 1
    missions = [mission(policy, tree, robots) for policy in (before, after, before)]
    texts = [compile_mission(each) for each in missions]
    result = run(
        missions[0],
        *([(1.0, Operate("R1", "job/one", ["k", ["a"], 0, 0, 0, 0]))] if tree == JOBS else []),
        (at_s, Revise("R1", texts[1], True, True)),
        (at_s + 2, Kill("R2")),
        (at_s + 3, Restart("R2")),
        (at_s + 6, Revise("R3", texts[2], True, True)),
    )
    facts = [agent.view.facts for agent in result.agents.values()]
    assert {each.in_force.number for each in facts} == {2}, result.stops


def test_robots_that_cannot_plan_the_revision_in_force_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As one does that was away while the others took it up."""
    first, then = mission("plain", TEAM, 1), mission("exclusive", TEAM, 1)
    reason = "it needs the extra 'planner'"

    def problem(found: Mission, lacks_planner: bool) -> str:
        return reason if found.number else ""

    monkeypatch.setattr("mrbt_mesh.core.agent.agent.planner_problem", problem)
    revise = (4 * S, Revise("R1", compile_mission(then), True, True))
    program = RobotProgram()

    @program.local_task("*")
    async def work(task: TaskContext, *arguments: str) -> None:
        await anyio.sleep(task.simulation.duration_s)

    result = simulate(first, program, seed=1, schedule=[revise], timeout_us=9 * S, inspect=False)
    assert result.stops == dict.fromkeys(("R1", "R2", "R3"), (2, reason))
