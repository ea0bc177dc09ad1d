"""What happens next: limits of blocked tasks, steps of schedules, times of jobs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.sim import Kill, simulate
from mrbt_mesh.sim.world.team_commands import Submit
from mrbt_mesh.views.model.next_steps import (
    NextStep,
    next_of_job,
    next_of_robot,
    next_of_task,
    run_seconds,
)
from mrbt_mesh.views.model.why import why_job
from tests.support.depot import depot, worker
from tests.support.watched import COVER, watched

TEXT = """
mission: lifting
ends: never
local_tasks: {lift: {work: 4}}
robot_types: {mover: {capabilities: {lift: 1}}}
robots: {R1: mover, R2: mover, R10: mover}
global_tasks: {raise: {needs: {lift: {min: 2, max: 2}}, blocked: {fail_after_s: 20}}}
jobs: {hoist: {parameters: {how: {min: 1, max: 3}}, deadline_s: 60, tree: raise}}
tree: {Jobs: {types: [hoist]}}
"""


def lifting() -> Mission:
    return mission_from_yaml(TEXT, "lifting", Path())


def seen_at(
    seconds: float, mission: Mission, schedule: list[Any], look: Callable[[Observer, int], Any]
) -> Any:
    """What `look` returns of a team in the simulator at this time."""
    found: list[Any] = []

    def look_on(observer: Observer, now_us: int) -> None:
        if not found and now_us >= seconds * SECOND_US:
            found.append(look(observer, now_us))

    steps = [(round(at_s * SECOND_US), step) for at_s, step in schedule]
    limit_us = round((seconds + 2) * SECOND_US)
    simulate(mission, worker(), seed=1, schedule=steps, timeout_us=limit_us, look_on=look_on)
    return found[0]


def test_a_blocked_job_fails_after_its_limit_unless_a_robot_is_started() -> None:
    schedule = [(2, Submit("hoist", [2], id="one")), (3, Kill("R1")), (3, Kill("R10"))]

    def look(observer: Observer, now_us: int) -> Any:
        told = next_of_job(observer, "one", now_us), next_of_task(observer, "raise", now_us)
        return *told, why_job(observer, "one")

    def ended_s(observer: Observer, now_us: int) -> Any:
        history = observer.record.job_log.jobs["one"]
        return history.state, observer.record.seconds(history.ended_us)

    job, task, why = seen_at(10, lifting(), schedule, look)
    fails, helps, expires = job
    # The robots themselves let it fail then.
    state, failed_s = seen_at(28, lifting(), schedule, ended_s)
    assert state == "failed"
    assert fails == NextStep("fails", pytest.approx(failed_s, abs=0.5))
    assert helps.text == "start R1 (`mrbt join R1`) or start R10 (`mrbt join R10`)"
    assert expires.text == "expires unless it has ended"
    assert expires.at_s == pytest.approx(61, abs=2)
    assert task == [fails, helps]
    assert why["subject"] == "job one"
    sentence = "one is waiting: raise is blocked: lift needs 2, 1 alive"
    assert why["sentence"].startswith(sentence)
    candidates = why["groups"][0]["candidates"]
    assert [each["robot"] for each in candidates] == ["R1", "R2", "R10"], "C2 before C10"


def test_a_job_that_is_carried_out_and_one_that_has_ended() -> None:
    schedule = [(2, Submit("hoist", [1], id="one"))]
    running = seen_at(5, lifting(), schedule, lambda seen, _: why_job(seen, "one"))
    assert running["sentence"].startswith("one is running: raise is carried out by R")
    ended = seen_at(12, lifting(), schedule, lambda seen, _: why_job(seen, "one"))
    assert ended["sentence"].startswith("one is succeeded. R")
    assert seen_at(12, lifting(), schedule, lambda seen, us: next_of_job(seen, "one", us)) == []


def test_a_job_that_may_not_begin_yet() -> None:
    schedule = [(2, Submit("hoist", [1], id="late", not_before_s=30))]
    first, *_ = seen_at(6, lifting(), schedule, lambda seen, us: next_of_job(seen, "late", us))
    assert first == NextStep("may begin", pytest.approx(31, abs=2))


def test_robots_at_work_should_end_it() -> None:
    schedule = [(2, Submit("hoist", [1], id="one"))]

    def look(observer: Observer, now_us: int) -> list[NextStep]:
        robots = observer.robots()
        return [step for robot in robots for step in next_of_robot(observer, robot, now_us)]

    steps = seen_at(4, lifting(), schedule, look)
    assert {step.text for step in steps} == {"should end lift"}
    assert all(step.at_s == pytest.approx(6, abs=1) for step in steps)


def test_robots_that_travel_begin_the_steps_of_the_schedule() -> None:
    mission = depot("Sequence: [scan_at(a), scan_at(b)]")

    def look(observer: Observer, now_us: int) -> list[list[NextStep]]:
        return [next_of_robot(observer, robot, now_us) for robot in ("R1", "R2", "R3")]

    steps = [step for each in seen_at(2, mission, [], look) for step in each]
    assert [step.text for step in steps] == ["begins scan(a) at a", "begins scan(b) at b"]
    assert all(step.at_s is not None and step.at_s > 2 for step in steps)


def test_a_dead_robot_is_counted_on_again_and_who_takes_over_is_named() -> None:
    script, observer = watched(COVER, "kill A", "pass 1500")
    (step,) = next_of_robot(observer, "A", script.team.now_us)
    assert step.text == "is counted on again once it is heard (`mrbt join A`)"


def test_nothing_happens_to_an_idle_robot_and_nothing_is_known_of_others() -> None:
    script, observer = watched(COVER)
    assert next_of_robot(observer, "C", script.team.now_us) == []
    for asked in (next_of_robot, next_of_task, next_of_job):
        with pytest.raises(KeyError):
            asked(observer, "X9", script.team.now_us)


def test_a_time_without_a_clock_is_not_known() -> None:
    _, observer = watched(COVER)
    assert run_seconds(observer, None) is None
