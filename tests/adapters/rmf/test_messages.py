"""What a server is sent is valid by the schemas, whatever a team is like."""

from __future__ import annotations

from dataclasses import asdict
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.rmf.messages import (
    STATUS,
    TaskHistory,
    charge,
    fleet_state,
    last_state,
    task_log,
    task_state,
)
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.observer.job_rows import JobRow
from tests.support.behaviour import mission_of
from tests.support.rmf import validator
from tests.support.watched import COVER, watched

ROWS = st.builds(
    JobRow,
    id=st.text(),
    type=st.text(),
    arguments=st.dictionaries(st.text(), st.text() | st.integers()),
    state=st.sampled_from(sorted(STATUS)),
    why=st.text(),
    priority=st.integers(),
    robots=st.lists(st.text()).map(tuple),
    operator=st.text(),
    not_before_us=st.integers(0),
    deadline_us=st.integers(0),
    submitted_us=st.none() | st.integers(0),
    begun_us=st.none() | st.integers(0),
    ended_us=st.none() | st.integers(0),
)
ONE_TASK = """
mission: m
local_tasks: {look: {}}
robot_types: {T: {capabilities: {look: 1}}}
robots: {A: T}
global_tasks: {look: {needs: {look: {}}}}
tree: look
"""
CANCELLED = st.none() | st.tuples(st.integers(), st.lists(st.text()))


@given(st.lists(ROWS, min_size=1, max_size=4), CANCELLED, st.lists(st.text()))
def test_states_and_logs_of_any_job(
    rows: list[JobRow], cancelled: tuple[int, list[str]] | None, labels: list[str]
) -> None:
    history = TaskHistory(labels=labels, cancelled=cancelled)
    for now_ms, row in enumerate(rows):
        history.follow(asdict(row), now_ms)
        data: dict[str, Any] = task_state(asdict(row), history, "depot")
        validator("task_state_update").validate({"type": "task_state_update", "data": data})
        log = {"type": "task_log_update", "data": task_log(row.id, history.log)}
        validator("task_log_update").validate(log)
    numbers = [entry["seq"] for entry in history.log]
    assert numbers == sorted(set(numbers))


def test_a_task_has_the_times_and_arguments_of_its_job() -> None:
    arguments = {"shelf": "shelf_1", "dock": "dock_1", "boxes": 3}
    times = {"submitted_us": 1_999, "begun_us": 2_000, "ended_us": 5_001}
    row = asdict(JobRow("one", "deliver", arguments, "succeeded", "", 0, ("D1", "D2"), "anna"))
    found = task_state(row | times, TaskHistory(), "depot")
    assert found["booking"]["unix_millis_request_time"] == 1
    assert (found["unix_millis_start_time"], found["unix_millis_finish_time"]) == (2, 5)
    assert (found["status"], found["assigned_to"]["name"]) == ("completed", "D1")
    assert found["detail"] == arguments
    asked = TaskHistory(requested_ms=7, priority={"type": "binary", "value": 1})
    booking = task_state(row | times, asked, "depot")["booking"]
    assert (booking["unix_millis_request_time"], booking["priority"]["type"]) == (7, "binary")


@pytest.mark.parametrize(
    ("battery", "share"),
    [
        ("min: 0, max: 100, default: 40", 0.4),
        ("min: 0, max: 1, decimals: 2, default: 0.25", 0.25),
        ("min: -10, max: 50, default: -3", 0.0),
        ("min: 0, max: 100", None),
        ("values: [low, high], default: low", None),
        ("min: -5, max: 0, default: -1", None),
    ],
)
def test_the_charge_of_a_battery_is_a_part_of_its_most(battery: str, share: float | None) -> None:
    text = ONE_TASK + f"blackboard: {{battery: {{{battery}, per: robot}}}}\n"
    mission = mission_of(text)
    observer: Any = SimpleNamespace(mission=mission, facts=TeamFacts(mission, "r"))
    assert charge(observer, "A") == share


@pytest.mark.parametrize(
    ("commands", "robot", "status"),
    [
        ((), "A", "working"),
        ((), "C", "idle"),
        (("kill A", "pass 300"), "A", "offline"),
        (("leave C", "pass 300"), "C", "shutdown"),
        (("tell A fault weld", "pass 100"), "A", "idle"),
    ],
)
def test_a_fleet_and_its_robots(commands: tuple[str, ...], robot: str, status: str) -> None:
    _, observer = watched(COVER, *commands)
    state = fleet_state(observer, "depot", 5)
    validator("fleet_state_update").validate({"type": "fleet_state_update", "data": state})
    assert state["robots"][robot]["status"] == status
    is_lost = any("fault" in command for command in commands)
    assert bool(state["robots"][robot]["issues"]) is is_lost


def test_a_task_whose_end_nobody_has_kept_is_an_error_not_completed() -> None:
    told = {"booking": {"id": "a"}, "status": "underway"}
    assert last_state(told, "succeeded")["status"] == "completed"
    for unknown in ("", "ended"):
        state = last_state(told, unknown)
        assert state["status"] == "error"
        validator("task_state").validate(state)
