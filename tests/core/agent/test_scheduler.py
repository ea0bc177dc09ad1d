"""Robots look for schedules where none is in force, and propose what is better than what is."""

from __future__ import annotations

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.schedules import Lookahead
from tests.core.planning.test_schedules import X, travelling
from tests.support.build import RUN, action, make_mission, micro, parallel
from tests.support.harness import TIMING, Process, Team


def mission(*names: str) -> Mission:
    can = dict.fromkeys(X, 1.0)
    tree = parallel(len(names), *map(action, names))
    at = {name: name for name in X}
    return travelling(make_mission(tree, {"R1": can, "R2": can}), at, {"R1": "a", "R2": "d"})


def started(of: Mission) -> Team:
    team = Team()
    for robot in of.robots:
        can = micro(dict.fromkeys(X, 1.0))
        config = AgentConfig(robot, "T", can, RUN, "n1", min_cost_flow, TIMING)
        team.start(robot, of, config)
    team.pass_time(3_000)
    return team


def ahead(process: Process) -> Lookahead:
    plan = process.agent.view.plan
    assert plan is not None
    assert plan.ahead is not None
    return plan.ahead


def test_every_robot_searches_once_and_the_best_that_is_found_is_in_force() -> None:
    team = started(mission(*X))
    one, two = team.processes["R1"], team.processes["R2"]
    last = [each.searches[-1] for each in (one, two)]
    assert ahead(one).schedule is None
    worst = tuple(reversed(last[0].find().schedule))
    team.give(one, inputs.ScheduleFound(last[0].number, worst))
    assert ahead(one).schedule
    assert ahead(one).schedule == ahead(two).schedule
    count = len(one.searches)
    team.give(two, inputs.ScheduleFound(last[1].number, last[1].find().schedule))
    team.give(two, inputs.ScheduleFound(last[1].number, worst))  # a second answer
    team.pass_time(5_000)
    assert ahead(one).course == ahead(two).course
    assert len(one.searches) == count, "one is in force"


def test_what_is_hardly_better_is_not_proposed() -> None:
    team = started(mission(*X))
    one, two = team.processes["R1"], team.processes["R2"]
    schedule = two.searches[-1].find().schedule
    for process in (one, two):
        team.give(process, inputs.ScheduleFound(process.searches[-1].number, schedule))
    said = [process.agent.view.facts.proposals for process in (one, two)]
    assert said[0] == said[1]
    assert len(said[0]) == 1, "the second robot has found the same"


def test_there_is_nothing_to_search_where_one_task_is_left_or_nothing_has_a_place() -> None:
    plain = make_mission(parallel(2, action("a"), action("b")), {"R1": {"a": 1}, "R2": {"b": 1}})
    for of in (mission("a"), plain):
        team = started(of)
        assert not any(process.searches for process in team.processes.values())


def test_it_searches_again_once_a_robot_has_died() -> None:
    team = started(mission(*X))
    one = team.processes["R1"]
    team.give(one, inputs.ScheduleFound(one.searches[-1].number, one.searches[-1].find().schedule))
    count = len(one.searches)
    team.kill("R2")
    team.pass_time(3_000)
    assert len(one.searches) == count + 1
    assert ahead(one).robots == ("R1",)
