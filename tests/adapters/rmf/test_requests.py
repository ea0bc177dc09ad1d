"""Requests of Open-RMF's task API, also wrong ones: every answer is valid by the schemas."""

from __future__ import annotations

import json
from typing import Any

import anyio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.rmf.requests import TaskApi
from tests.support.one_robot import DeskClient
from tests.support.rmf import ALL, messages, perhaps_wrong, response_to, validator

REQUESTS = sorted(name for name in ALL if name.endswith("_request") and name != "task_request")
IDS = st.sampled_from(["one", "two", "never seen", ""])
ARGUMENTS = st.fixed_dictionaries(
    {}, optional={"where": st.sampled_from(["shelf_1", "moon", 3, None]), "more": st.text()}
)
DISPATCHES = st.fixed_dictionaries(
    {"category": st.sampled_from(["inspect", "paint"]), "description": ARGUMENTS | st.text()},
    optional={
        "priority": st.dictionaries(st.sampled_from(["value", "type"]), st.integers() | st.text()),
        "unix_millis_earliest_start_time": st.integers(),
        "labels": st.lists(st.sampled_from(["id=one", "id=two", "id=not an id", "dashboard"])),
        "requester": st.text(),
        "fleet_name": st.sampled_from(["depot", "other"]),
    },
)


def asked(api: TaskApi, *messages: Any) -> tuple[dict[str, Any], str]:
    """The answer to the last of these messages; each answer is valid."""
    for message in messages:
        text = message if isinstance(message, str) else json.dumps(message)
        answer, wrong = anyio.run(api.answer, text)
        kind = message.get("type") if isinstance(message, dict) else None
        # Of wrong requests, and those that are for answers without room for errors.
        name = "simple_response" if wrong else response_to(kind)
        validator(name).validate(json.loads(json.dumps(answer, allow_nan=False)))
    return answer, wrong


def dispatch(**request: Any) -> dict[str, Any]:
    usual = {"category": "inspect", "description": {"where": "shelf_1"}, "labels": ["id=one"]}
    return {"type": "dispatch_task_request", "request": usual | request}


@pytest.fixture
def api() -> TaskApi:
    return TaskApi(DeskClient(), "depot", lambda: 5)


def test_a_task_from_dispatch_to_cancellation(api: TaskApi) -> None:
    same = dispatch(labels=["id=one", "dashboard"], priority={"value": 7})
    answer, _ = asked(api, same)
    booking = answer["state"]["booking"]
    assert (booking["id"], booking["labels"]) == ("one", ["id=one", "dashboard"])
    assert (booking["priority"]["value"], answer["state"]["status"]) == (7, "queued")
    assert asked(api, same)[0]["state"]["booking"]["id"] == "one", "the same task again"
    refused, _ = asked(api, dispatch())
    assert (refused["success"], refused["errors"][0]["code"]) == (False, 409), "another priority"
    interrupted, _ = asked(api, {"type": "interrupt_task_request", "task_id": "one"})
    assert asked(api, same)[0]["state"]["status"] == "standby"
    tokens = [interrupted["token"]]
    asked(api, {"type": "resume_task_request", "for_task": "one", "for_tokens": tokens})
    assert asked(api, same)[0]["state"]["status"] == "queued"
    assert asked(api, {"type": "cancel_task_request", "task_id": "one"})[0] == {"success": True}
    state = asked(api, same)[0]["state"]
    assert state["status"] == "canceled"
    assert state["cancellation"] == {"unix_millis_request_time": 5, "labels": []}


@pytest.mark.parametrize(
    ("message", "code", "text", "is_wrong"),
    [
        ("no json", 422, "it is not JSON", True),
        ("[" * 100_000, 422, "it is not JSON", True),
        ({"type": "paint_request"}, 422, "its type is 'paint_request'", True),
        ({"type": "cancel_task_request"}, 422, "must contain ['task_id'] properties", True),
        ({"type": "resume_task_request"}, 422, "for_task is missing", True),
        (dispatch(description="shelf_1"), 422, "an argument by each name", True),
        (dispatch(fleet_name="other"), 422, "this is the fleet depot", True),
        (dispatch(unix_millis_earliest_start_time=10**30), 422, "no time in this era", True),
        (dispatch(description={"where": "moon"}), 422, "where is one of dock_1", False),
        (dispatch(category="paint"), 422, "no job type 'paint'; known: deliver, inspect", False),
        (dispatch(labels=["id=silent"]), 504, "D1 does not answer", False),
        ({"type": "cancel_task_request", "task_id": "two"}, 404, "no job 'two' is known", False),
        ({"type": "task_log_request", "task_id": "two"}, 404, "no job 'two' is known", False),
    ],
)
def test_what_cannot_be_done_is_said_with_the_remedy(
    api: TaskApi, message: Any, code: int, text: str, is_wrong: bool
) -> None:
    answer, wrong = asked(api, message)
    assert (answer["success"], answer["errors"][0]["code"], bool(wrong)) == (False, code, is_wrong)
    assert text in answer["errors"][0]["detail"]


def test_the_types_of_jobs_are_discovered(api: TaskApi) -> None:
    answer, _ = asked(api, {"type": "task_discovery_request"})
    tasks = {task["category"]: task["description_schema"] for task in answer["data"]["tasks"]}
    assert sorted(tasks) == ["deliver", "inspect"]
    boxes = tasks["deliver"]["properties"]["boxes"]
    assert boxes == {"type": "integer", "minimum": 1, "maximum": 4}


@given(st.data())
def test_any_request_has_a_valid_answer_and_is_wrong_only_if_its_schema_or_the_text_says_so(
    data: st.DataObject,
) -> None:
    api = TaskApi(DeskClient(), "depot", lambda: 5)
    asked(api, dispatch())
    name = data.draw(st.sampled_from(REQUESTS))
    message = data.draw(
        messages(ALL[name]).flatmap(perhaps_wrong)
        | st.builds(lambda task: {"type": name, "task_id": task, "for_task": task}, IDS)
        | st.builds(lambda request: {"type": name, "request": request}, DISPATCHES)
    )
    answer, wrong = asked(api, message)
    if not validator(name).is_valid(message):
        assert wrong
        assert answer["errors"][0]["code"] == 422
