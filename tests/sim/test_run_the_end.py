"""A mission that has ended has ended on all robots, whatever conditions turn afterwards."""

from __future__ import annotations

from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotContext, RobotProgram, TaskContext
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.planning import make_plan
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.sim import SimulationResult, simulate
from mrbt_mesh.sim.world.setup import AgentOptions
from tests.support.behaviour import mission_of

robot = RobotProgram()


@robot.local_task("*")
async def work(task: TaskContext) -> bool:
    """A second of work."""
    task.record_event({"robot": task.robot, "local_task": task.local_task})
    await anyio.sleep(1.0)
    return not task.local_task.startswith("fail")


@robot.background
async def sense(context: RobotContext) -> None:
    """R2 sets `go` at the time that the mission names."""
    if context.robot == "R2":
        await anyio.sleep(context.parameters["at_s"])
        context.set_condition("go", True)


MISSION = """
mission: the_end
ends: {ends}
parameters: {{at_s: {at_s}}}
local_tasks: {{fail: {{}}, a: {{}}}}
conditions: {{go: {{}}}}
robot_types: {{T: {{capabilities: {{fail: 1, a: 1}}}}}}
robots: {{R1: T, R2: T, R3: T}}
global_tasks:
  fail: {{needs: {{fail: {{}}}}, failure: paper}}
  a: {{needs: {{a: {{}}}}}}
tree: {tree}
"""
# The first fails after a second, the second succeeds at once; with `go` both would have `a` done.
FAILS = "{Sequence: [{Fallback: [{Condition: go}, fail]}, a]}"
SUCCEEDS = "{Fallback: [{Inverter: {Sequence: [{Condition: go}, a]}}]}"


def run(
    tree: str, at_s: float, agents: AgentOptions | None = None, ends: str = "once"
) -> SimulationResult:
    return simulate(
        mission_of(MISSION.format(tree=tree, at_s=at_s, ends=ends)),
        robot,
        seed=1,
        timeout_us=5_000_000,
        agents=agents,
    )


@pytest.mark.parametrize("stays", [True, False])
@pytest.mark.parametrize("at_s", [1.05, 1.1, 1.2])
@pytest.mark.parametrize(("tree", "result"), [(FAILS, "failure"), (SUCCEEDS, "success")])
def test_a_condition_that_turns_after_the_end_changes_nothing(
    tree: str, result: str, at_s: float, stays: bool
) -> None:
    found = run(tree, at_s, AgentOptions(exit_when_done=not stays))
    assert not found.violations
    assert found.result == result
    assert "a" not in [event["local_task"] for event in found.events]
    plans = [agent.view.plan for agent in found.agents.values()]
    assert {plan.result.name.lower() for plan in plans if plan} == {result}


@pytest.mark.parametrize(("at_s", "ends"), [(0.9, "once"), (1.1, "never")])
def test_it_does_before_the_end_and_where_there_is_none(at_s: float, ends: str) -> None:
    """So the tests above can fail."""
    found = run(FAILS, at_s, ends=ends)
    assert found.result == "success"
    assert [event["local_task"] for event in found.events] == ["fail", "a"]


def test_the_checkers_notice_who_starts_after_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    end = Planner._end

    def end_once(planner: Planner, plan: Plan) -> list[tuple[str, Any]]:
        return end(planner, plan) if planner._context.facts.result(()) is None else []

    monkeypatch.setattr(Planner, "_end", end_once)
    monkeypatch.setattr(make_plan, "_is_at_rest", lambda *_: False)
    found = run(FAILS, 1.05, AgentOptions(exit_when_done=False))
    assert "I3" in found.violations[0]
    assert "but knows that the mission has ended" in found.violations[0]
