"""Why: sentences with numbers, for robots, tasks and takeovers."""

from __future__ import annotations

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import simulate
from mrbt_mesh.views.model.changes import ChangeLog
from mrbt_mesh.views.model.team_view import TakeoversView
from mrbt_mesh.views.model.why import candidates, why_robot, why_takeover, why_task
from tests.support.paths import mission_file
from tests.support.watched import COVER, WELD, watched


def observed(*commands: str) -> Observer:
    return watched(COVER, *commands)[1]


def test_a_robot_at_work_and_who_else_could() -> None:
    told = why_robot(observed(), "A")
    assert told["sentence"].startswith("A does weld for weld: goes on with what it runs")
    assert "B (0.5) is free: weld: enough robots are on it" in told["sentence"]
    rows = told["groups"][0]["candidates"]
    assert [(row["robot"], row["performance"], row["chosen"]) for row in rows] == [
        ("A", 1.0, True),
        ("B", 0.5, False),
    ]


def test_an_idle_robot() -> None:
    told = why_robot(observed(), "C")
    assert told["sentence"] == "C does nothing now: nothing it can do is needed now."
    assert told["groups"] == []


def test_a_dead_robot_and_who_took_over() -> None:
    observer = observed("kill A", "pass 300")
    sentence = why_robot(observer, "A")["sentence"]
    assert "A died at " in sentence
    assert "the others knew after " in sentence
    assert "B took over its weld after " in sentence
    (fault,) = observer.record.major
    told = why_takeover(observer, fault)
    assert told["subject"] == "takeover of weld"
    assert "B does it with 0.5." in told["sentence"]
    assert "A (1) is dead" in told["sentence"]


def test_of_a_takeover_before_the_view_was_opened_the_reasons_are_not_known() -> None:
    observer = observed("kill A", "pass 300")
    log = ChangeLog()
    TakeoversView(observer).put(log)
    told = log.since(0)["why/0"]
    assert "B took over its weld after " in told["sentence"]
    assert told["groups"] == []
    assert "is dead" not in told["sentence"]


def test_a_robot_that_held_nothing_is_replaced_by_nobody() -> None:
    observer = observed("kill C", "pass 300")
    assert why_robot(observer, "C")["sentence"].endswith("It held no task.")
    assert why_takeover(observer, observer.record.major[0])["subject"] == "death of C"


def test_tasks_idle_running_blocked_and_done() -> None:
    observer = observed()
    assert "does not reach it now" in why_task(observer, "cover")["sentence"]
    assert why_task(observer, "weld")["sentence"].startswith("weld is carried out by A.")
    observer = observed("succeed A", "kill B", "pass 1500")
    assert why_task(observer, "weld")["sentence"] == "weld has succeeded. A took part."
    told = why_task(observer, "cover")
    assert told["sentence"].startswith("cover is blocked: lift needs 2, 1 alive. It needs 2 for")
    assert [row["reason"] for row in told["groups"][0]["candidates"]][-1] == "is dead"


def test_lost_capabilities_are_a_reason() -> None:
    observer = observed("tell B fault weld", "pass 200")
    assert observer.plan is not None
    activation = observer.plan.evaluation.requests[0].activation
    found = {each.robot: each.reason for each in candidates(observer, activation, "weld")}
    assert found["B"] == "has lost this capability: operator"


def test_the_reasons_of_failures_are_told() -> None:
    mission = load_mission(mission_file("tool_search"))
    program = load_program(mission.program or "")
    observer = simulate(mission, program, seed=1).observer
    failed = {end.global_task: end for end in observer.record.failures}
    assert failed
    for task, end in failed.items():
        told = f"{end.robot} failed at {end.local_task}: {end.reason}."
        assert told in why_task(observer, task)["sentence"]


def test_what_is_not_known_is_an_error() -> None:
    with pytest.raises(KeyError):
        why_robot(observed(), "Z")
    with pytest.raises(KeyError):
        why_task(observed(), "nothing")


def test_a_death_before_the_run_was_watched_has_no_numbers() -> None:
    _, observer = watched(WELD, "kill A", "pass 1500")
    (fault,) = observer.record.major
    fault.is_older = True
    assert why_takeover(observer, fault)["sentence"].startswith(
        "A died before the run was watched. B has its weld since."
    )
