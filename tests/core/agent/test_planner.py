"""T_A at work: its status follows from the plan, and T_i shows it."""

from __future__ import annotations

from mrbt_mesh.core.agent import effects as fx
from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.bt.tree import Status
from tests.support import build
from tests.support.script import Script

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE

TEAM = """
robot A lift
robot B lift
robot C look
task cover lift 2..2
tree Parallel(2, "cover", "look")
start A B C
pass 1000
"""


def team(text: str = TEAM) -> Script:
    script = Script()
    script.block(text.strip().splitlines())
    return script


def view(script: Script, robot: str) -> AgentView:
    return script.team.processes[robot].agent.view


def test_an_infeasible_assignment_is_a_failure_of_t_a_and_so_of_t_i() -> None:
    script = team(TEAM.replace('Parallel(2, "cover", "look")', '"cover"'))
    assert view(script, "A").statuses[:3] == (RUNNING, SUCCESS, RUNNING)
    script.block(["kill B", "pass 3000"])
    # The mission goes on waiting: its result is that of T_G.
    assert view(script, "A").statuses[:3] == (FAILURE, FAILURE, RUNNING)
    heard = view(script, "C").peers["A"].heartbeat
    assert heard is not None
    assert heard.statuses == tuple(map(int, view(script, "A").statuses))
    script.block(["start B", "pass 3000"])
    assert view(script, "A").statuses[:3] == (RUNNING, SUCCESS, RUNNING)


def test_a_request_that_waits_beside_others_is_no_failure() -> None:
    script = team()
    script.block(["kill B", "pass 3000"])
    plan = view(script, "A").plan
    assert plan is not None
    assert [each.global_task for each in plan.waiting] == ["cover"]
    assert view(script, "A").statuses[1] is SUCCESS


def test_t_a_is_running_while_a_plan_is_made_elsewhere() -> None:
    mission = build.make_mission(
        build.action("cover"), {"A": {"lift": 1.0}}, [build.task("cover", ("lift", 2, 2))]
    )
    able, solver = build.micro({"lift": 1.0}), min_cost_flow
    config = AgentConfig("A", "T", able, build.RUN, "n1", solver, plans_apart=True)
    agent, asked, now_us = Agent(mission, config, 0), None, 0
    while asked is None:
        effects = agent.handle(inputs.TimerFired(), now_us)
        asked = next((each for each in effects if isinstance(each, fx.MakePlan)), None)
        now_us = agent.next_deadline_us(now_us)
    agent.handle(inputs.PlanMade(asked.number, asked.make()), now_us)
    assert agent.view.statuses[1] is FAILURE
    effects = agent.handle(inputs.CapabilityChanged("lift", lost=True), now_us)
    asked = next(each for each in effects if isinstance(each, fx.MakePlan))
    assert agent.view.statuses[:2] == (RUNNING, RUNNING)
    agent.handle(inputs.PlanMade(asked.number, asked.make()), now_us)
    assert agent.view.statuses[:2] == (FAILURE, FAILURE)
