"""Robots look for schedules where none is in force, and propose what is better than what is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.agent import inputs, scheduler
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.effects import SearchSchedule
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Proposal, TravelTimes
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import Mission, MissionEnd
from mrbt_mesh.core.mission.travel import MICRO
from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.core.scheduling import problem
from mrbt_mesh.core.scheduling.problem import Schedule
from tests.core.planning.test_schedules import X, travelling
from tests.support.build import RUN, action, condition, make_mission, micro, parallel, sequence
from tests.support.harness import TIMING, Process, Team


def mission(*names: str) -> Mission:
    can = dict.fromkeys(X, 1.0)
    tree = parallel(len(names), *map(action, names))
    at = {name: name for name in X}
    return travelling(make_mission(tree, {"R1": can, "R2": can}), at, {"R1": "a", "R2": "d"})


def started(of: Mission, host: str = "") -> Team:
    team = Team()
    for robot in of.robots:
        can = micro(dict.fromkeys(X, 1.0))
        config = AgentConfig(
            robot,
            "T",
            can,
            RUN,
            "n1",
            min_cost_flow,
            TIMING,
            host=host,
            expected=frozenset(of.robots),
        )
        team.start(robot, of, config)
    team.pass_time(3_000)
    return team


def best_of(search: SearchSchedule) -> Schedule:
    *_, best = search.steps
    return best.schedule


def answer(team: Team) -> None:
    """Every robot finds what it searches, until none searches any more."""
    for process in team.processes.values():
        while process.searches:
            search = process.searches.pop(0)
            team.give(process, inputs.ScheduleFound(search.number, best_of(search)))


def standing(process: Process) -> list[str]:
    """The robots that propose a schedule."""
    found = process.agent.view.facts.proposals
    return sorted(robot for robot, proposal in found.items() if proposal.steps)


def ahead(process: Process) -> Lookahead:
    plan = process.agent.view.plan
    assert plan is not None
    assert plan.ahead is not None
    return plan.ahead


def test_every_robot_searches_once_and_the_best_that_is_found_is_in_force(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scheduler, "LITTLE_WORK", 0)
    team = started(mission("a", "c", "d"))
    one, two = team.processes["R1"], team.processes["R2"]
    by_rules = ahead(one).course
    assert by_rules is not None
    assert ahead(one).author == ""
    late = two.searches[-1]
    assert one.searches
    answer(team)
    team.give(two, inputs.ScheduleFound(late.number, ()))
    assert ahead(one).schedule == ahead(two).schedule
    best = ahead(one).course
    assert best is not None
    assert best.cost < by_rules.cost
    team.pass_time(5_000)
    assert not one.searches + two.searches, "one is in force"
    assert standing(one) == [ahead(one).author], "others have been taken back"


def test_the_first_robot_at_once_proposes_what_a_few_orders_come_to() -> None:
    team = started(mission("a", "c", "d"))
    assert standing(team.processes["R2"]) == ["R1"]


def test_a_schedule_much_worse_than_what_rules_come_to_is_outdone_at_once() -> None:
    tree = sequence(condition("go"), parallel(2, action("a"), action("d")))
    of = mission("a", "d")
    waiting = make_mission(tree, {robot: dict.fromkeys(X, 1.0) for robot in of.robots})
    conditions = {"go": ConditionType("go")}
    team = started(replace(waiting, travel=of.travel, ends=MissionEnd.NEVER, conditions=conditions))
    one, two = team.processes["R1"], team.processes["R2"]
    begin = [
        records.ProposedStep(f"{RUN}:{node}:{name}::0", ((robot,),))
        for node, name, robot in ((3, "a", "R2"), (4, "d", "R1"))
    ]
    two.agent._context.write([(records.SCHEDULE, Proposal(tuple(begin)))], team.now_us)
    team.give(one, inputs.ConditionSet("go", True))
    team.pass_time(200)
    claims = one.agent.view.claim, two.agent.view.claim
    assert [each and each.global_task for each in claims] == ["a", "d"]


@pytest.mark.parametrize(("margin", "proposed"), [(100, True), (1, False)])
def test_what_is_hardly_better_is_not_proposed(
    margin: int, proposed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(problem, "MARGIN", margin)
    team = started(mission("a", "c", "d"))
    answer(team)
    found = ahead(team.processes["R1"])
    assert found.course is not None
    assert (found.course.cost <= found.by_rules().cost) == proposed, "what was found alone stays"


def test_where_rules_alone_are_as_good_one_robot_proposes_what_they_come_to() -> None:
    team = started(mission("a", "d"))
    one, two = team.processes["R1"], team.processes["R2"]
    answer(team)
    assert len(standing(two)) == 1
    team.pass_time(3_000)
    assert not one.searches + two.searches


def test_of_robots_on_one_computer_the_first_one_searches() -> None:
    team = started(mission(*X), host="pc")
    one, two = team.processes["R1"], team.processes["R2"]
    answer(team)
    one_more = [len(one.searches), len(two.searches)]
    team.kill("R1")
    team.pass_time(3_000)
    assert one_more == [0, 0]
    assert len(two.searches) == 1


def test_there_is_nothing_to_search_where_one_task_is_left_or_nothing_has_a_place() -> None:
    plain = make_mission(parallel(2, action("a"), action("b")), {"R1": {"a": 1}, "R2": {"b": 1}})
    for of in (mission("a"), plain):
        team = started(of)
        assert not any(process.searches for process in team.processes.values())


def test_it_searches_again_once_travel_times_have_changed() -> None:
    team = started(mission(*X))
    answer(team)
    one, two = team.processes["R1"], team.processes["R2"]
    times = TravelTimes(("a", "b"), ((0, 90_000), (90_000, 0)))
    for _ in range(2):  # the second time that is no news
        team.give(one, inputs.TravelTimesMade(times))
        assert ahead(two).problem.travel_ms[0][0][1] == 90_000
    assert [len(process.searches) for process in (one, two)] == [1, 1]
    answer(team)
    team.pass_time(3_000)
    assert not one.searches + two.searches
    assert two.agent.view.facts.map.get("R1", records.TRAVEL_TIMES) is not None


def test_it_searches_again_once_a_robot_has_died() -> None:
    team = started(mission(*X))
    answer(team)
    team.kill("R2")
    team.pass_time(3_000)
    one = team.processes["R1"]
    assert len(one.searches) == 1
    assert ahead(one).robots == ("R1",)


def test_a_robot_on_its_way_says_each_time_that_half_as_much_is_left() -> None:
    of = mission("a")
    travel = of.travel
    assert travel is not None
    far = replace(travel, at={"a": "d"}, start={"R1": "a"}, speeds={"T": MICRO // 2})
    only = replace(of, robots={"R1": of.robots["R1"]}, travel=far)
    team = started(only)
    one = team.processes["R1"]
    whole_ms, said = far.way_ms("T", "a", "d"), list[int]()
    for _ in range(whole_ms // 100 + 20):
        noted = one.agent.view.facts.overtakings.get("R1")
        if noted is not None and noted.left_ms not in said:
            said.append(noted.left_ms)
            assert not noted.counts
            row = ahead(one).problem.travel_ms[0][ahead(one).problem.at[0]]
            assert row[list(far.places).index("d")] == noted.left_ms
        team.pass_time(100)
    halves = [whole_ms // 2**n for n in range(1, 20) if whole_ms // 2**n >= 1_000]
    assert len(said) == len(halves) >= 3
    assert all(abs(ms - half) < 5 for ms, half in zip(said, halves, strict=True)), said
