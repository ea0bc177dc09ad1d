"""Robots that drive in virtual time: where they are, also when a way is broken off."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotContext, TaskContext
from mrbt_mesh.drills.physical import spans
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.sim.run import SimulationResult, simulate
from mrbt_mesh.sim.world.driving import Leg, duration_ms, legs_to, spot_after
from mrbt_mesh.sim.world.faults import Kill, Lose, Restart
from mrbt_mesh.sim.world.setup import FailureModel
from tests.support.build import jointly
from tests.support.depot import SECOND, depot, worker


def told(result: SimulationResult, robot: str = "") -> list[tuple[float, str, str, str]]:
    """Time in s, robot, event and what for; where a robot sets out, to which place."""
    assert result.violations == []
    return [
        (
            round(e["t"], 1),
            e["robot"],
            e["event"] + (f" to {e['place']}" if "place" in e else ""),
            e["outcome"] or e["local_task"],
        )
        for e in result.events
        if robot in ("", e["robot"])
    ]


def test_a_robot_sets_out_begins_and_ends() -> None:
    mission = depot("Sequence: [scan_at(a), scan_at(a), scan_at(b)]")
    result = simulate(mission, worker(), seed=1, robots=["R1"])
    assert told(result) == [
        (0.0, "R1", "start to a", "scan"),
        (4.0, "R1", "begin", "scan"),
        (5.0, "R1", "end", "success"),
        (5.0, "R1", "start", "scan"),
        (6.0, "R1", "end", "success"),
        (6.0, "R1", "start to b", "scan"),
        (16.0, "R1", "begin", "scan"),
        (17.0, "R1", "end", "success"),
    ]
    assert result.checks["I4"] >= 3
    assert [round(each.start_s) for each in spans(result.events)] == [4, 5, 16]


def test_a_coalition_gathers_and_one_that_dies_on_its_way_is_replaced() -> None:
    mission = depot("Sequence: [scan_at(a), lift_at(b)]")
    result = simulate(mission, worker(), seed=1, schedule=[(7 * SECOND, Kill("R2"))])
    assert result.result == "success"
    # Three robots that join together begin nothing for 50 ms.
    assert sorted(told(result)[3:]) == [
        (5.1, "R2", "start to b", "lift"),
        (5.1, "R3", "start to b", "lift"),
        (7.0, "R1", "start to b", "lift"),
        (17.0, "R1", "begin", "lift"),
        (17.0, "R3", "begin", "lift"),
        (19.0, "R1", "end", "success"),
        (19.0, "R3", "end", "success"),
    ]


@pytest.mark.parametrize("exclusive", [False, True])
def test_a_robot_that_starts_again_goes_on_from_where_it_stopped(exclusive: bool) -> None:
    mission = depot("Sequence: [lift_at(b)]")
    tasks = {
        n: replace(t, joint=jointly(exclusive=exclusive)) for n, t in mission.global_tasks.items()
    }
    mission = replace(mission, global_tasks=tasks)
    schedule = [(at_s * SECOND, Kill(robot)) for at_s, robot in ((1, "R2"), (1, "R3"))]
    schedule += [(4 * SECOND, Restart("R2"))]
    result = simulate(mission, worker(), seed=1, schedule=schedule)
    (_, _, first, _), (start_s, _, again, _), (begin_s, _, begin, _), *_ = told(result, "R2")
    assert [first, again, begin] == ["start to b", "start to b", "begin"]
    assert begin_s - start_s == pytest.approx(5, abs=0.11)  # 1 s of 6 was over


def test_a_robot_whose_way_is_broken_off_turns_round_or_goes_on() -> None:
    mission = depot("Parallel: {success: all, children: [scan_at(a), scan_at(b)]}")
    schedule = [(2 * SECOND, Lose("R1", "scan(a)", ""))]
    result = simulate(mission, worker(), seed=1, robots=["R1"], schedule=schedule)
    assert told(result)[:4] == [
        (0.0, "R1", "start to a", "scan"),
        (2.0, "R1", "cancel", "scan"),
        (2.0, "R1", "start to b", "scan"),
        (10.0, "R1", "begin", "scan"),
    ]
    assert round(spans(result.events)[0].start_s) == 10


def test_a_program_that_drives_is_asked_and_may_fail() -> None:
    program, asked = worker(), list[str]()

    @program.travel
    async def drive(task: TaskContext, place: str) -> bool:
        asked.append(f"{task.robot} {place}")
        await anyio.sleep(1)
        if task.robot == "R1":
            raise RuntimeError("the road is closed")
        return True

    result = simulate(depot("Sequence: [lift_at(a)]"), program, seed=1)
    assert (result.result, result.violations, asked) == ("success", [], ["R1 a", "R2 a", "R3 a"])
    lost = result.observer.facts.members["R1"].member.lost
    assert list(lost) == ["lift(a)"]
    assert lost["lift(a)"].startswith("cannot reach a: RuntimeError: the road is closed (test_dr")
    result = simulate(depot("Sequence: [scan_at(a)]"), program, seed=1)
    assert told(result)[:3] == [
        (0.0, "R1", "start to a", "scan"),
        (1.0, "R1", "end", "failure"),
        (1.0, "R2", "start to a", "scan"),
    ]


def test_travel_times_of_the_program_replace_the_declared_ones() -> None:
    program = worker()

    @program.travel_time
    async def seconds(context: RobotContext, origin: str, goal: str) -> float | None:
        await anyio.lowlevel.checkpoint()
        return 9.5 if (context.robot, origin, goal) == ("R1", "a", "b") else None

    result = simulate(depot("Sequence: [scan_at(a), scan_at(b)]"), program, seed=1, robots=["R1"])
    assert [e for e in told(result) if e[2] == "begin"] == [
        (4.0, "R1", "begin", "scan"),
        (14.5, "R1", "begin", "scan"),
    ]
    said = result.observer.facts.travel_times["R1"]
    assert (said.places, said.ways_ms[0]) == (("a", "b", "home"), (0, 9_500, None))


async def _late(origin: str, goal: str) -> float:
    await anyio.sleep(3)
    return 1.0


def _no_map(origin: str, goal: str) -> float:
    raise KeyError(goal)


@pytest.mark.parametrize(
    ("function", "problem"),
    [
        (_no_map, "from a to home: KeyError: 'home' (test_driving.py:"),
        (lambda a, b: "far", "from a to home: <lambda> returned 'far' (test_driving.py:"),
        (lambda a, b: float("nan"), "from a to home: <lambda> returned nan (test_driving.py:"),
        (lambda a, b: -1, "from a to home: <lambda> returned -1 (test_driving.py:"),
        (lambda a, b: True, "from a to home: <lambda> returned True (test_driving.py:"),
        (_late, "from home to a: not ready within 5 s; all are as the mission declares"),
    ],
)
def test_declared_travel_times_are_used_where_the_function_fails(
    function: Any, problem: str
) -> None:
    program = worker()
    program.travel_time(function)
    result = simulate(depot("Sequence: [scan_at(a)]"), program, seed=1, timeout_us=60 * SECOND)
    assert told(result)[1] == (4.0, "R1", "begin", "scan")
    assert result.observer.facts.travel_times == {}
    for robot in ("R1", "R2", "R3"):
        assert result.observer.facts.problems[robot]["travel times"].startswith(problem)


def test_travel_times_are_evaluated_again_when_the_program_asks() -> None:
    program, closed = worker(), set[str]()

    @program.travel_time
    def seconds(origin: str, goal: str) -> float:
        if "no map" in closed:
            raise OSError("no map")
        return 8.0 if goal in closed else 2.0

    @program.background
    async def listen(context: RobotContext) -> None:
        for news in ("a", "no map"):
            await anyio.sleep(1)
            closed.add(news)
            context.update_travel_times()
        await anyio.sleep(60)

    said = []

    def look(observer: Observer, _: int) -> None:
        times = observer.facts.travel_times.get("R1")
        if times is not None and times not in said:
            said.append(times)

    mission = depot("Sequence: [scan_at(a), scan_at(a), scan_at(a)]")
    result = simulate(mission, program, seed=1, robots=["R1"], look_on=look)
    assert result.violations == []
    assert [times.ways_ms for times in said] == [
        ((0, 2_000), (2_000, 0)),
        ((0, 2_000), (8_000, 0)),
        (),
    ]
    silent = worker()
    silent.background(costs="none")(listen)
    result = simulate(mission, silent, seed=1, robots=["R1"])
    assert "the program has no function @robot.travel_time" in str(
        result.observer.facts.problems["R1"]
    )


def test_noise_is_the_same_for_the_same_seed() -> None:
    mission, times = depot("Sequence: [scan_at(a), scan_at(b)]"), []
    for seed in (1, 1, 2):
        result = simulate(mission, worker(), seed=seed, noise_permille=300)
        begin, end = (line for line in told(result)[1:3])
        assert 2.8 <= begin[0] <= 5.2
        assert 0.7 <= end[0] - begin[0] <= 1.3
        times.append(told(result))
    assert times[0] == times[1] != times[2]


def test_the_shorter_way_from_between_two_places() -> None:
    travel = depot("Sequence: [scan_at(a)]").travel
    assert travel is not None
    on, back = Leg("home", "b", 6_000, 5_500), Leg("home", "b", 6_000, 500)
    table = travel.table("mover")
    assert [duration_ms(legs_to(travel, table, s, "b")) for s in (on, back)] == [500, 5_500]
    assert duration_ms(legs_to(travel, table, back, "a")) == 4_500
    legs = legs_to(travel, table, back, "a")
    assert spot_after(legs, 200) == Leg("b", "home", 6_000, 5_700)
    assert spot_after(legs, 600) == Leg("home", "a", 4_000, 100)
    assert spot_after(legs, 9_000) == Leg("home", "a", 4_000, 4_000)


def test_chances_of_actions_are_not_those_of_ways() -> None:
    failures = FailureModel(actions={"": 1.0})
    result = simulate(depot("Sequence: [scan_at(a)]"), worker(), seed=1, failures=failures)
    assert [e for *_, e, _ in told(result)] == ["start to a", "begin", "end"] * 3
