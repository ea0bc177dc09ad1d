"""What a server is sent is valid by the schemas, whatever a team is like."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.rmf.messages import STATUS, TaskHistory, fleet_state, task_log, task_state
from mrbt_mesh.core.observer.job_rows import JobRow
from tests.support.rmf import validator
from tests.support.watched import COVER, watched

ROWS = st.builds(
    JobRow,
    id=st.text(),
    type=st.text(),
    arguments=st.dictionaries(st.text(), st.text()),
    state=st.sampled_from(sorted(STATUS)),
    why=st.text(),
    priority=st.integers(),
    robots=st.lists(st.text()).map(tuple),
    operator=st.text(),
    not_before_us=st.integers(0),
    deadline_us=st.integers(0),
)
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


def test_the_times_of_a_job_are_those_that_were_seen() -> None:
    history = TaskHistory()
    row = asdict(JobRow("one", "inspect", {}, "waiting", "", 0, (), "anna"))
    for now_ms, state in enumerate(("waiting", "running", "waiting", "running", "succeeded")):
        history.follow(row | {"state": state}, now_ms)
    older = TaskHistory()
    older.follow(row | {"state": "running"}, 7, is_older=True)
    assert older.started_ms is None
    found = task_state(row | {"state": "succeeded", "robots": ("D1", "D2")}, history, "depot")
    assert (found["unix_millis_start_time"], found["unix_millis_finish_time"]) == (1, 4)
    assert (found["status"], found["assigned_to"]["name"]) == ("completed", "D1")


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
