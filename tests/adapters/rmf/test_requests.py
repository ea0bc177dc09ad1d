"""Requests of Open-RMF's task API, also wrong ones: every answer is valid by the schemas."""

from __future__ import annotations

import json
from http import HTTPStatus
from typing import Any

import anyio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.rmf import requests
from mrbt_mesh.adapters.rmf.own_errors import OwnErrors
from mrbt_mesh.adapters.rmf.requests import TaskApi
from mrbt_mesh.runtime.team_client import TeamClient
from tests.support.one_robot import MISSION, DeskClient
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


def direct(**more: Any) -> dict[str, Any]:
    usual = {"type": "robot_task_request", "fleet": "depot", "robot": "D1"}
    return usual | {"request": dispatch()["request"]} | more


def resume(name: str, *tokens: str) -> dict[str, Any]:
    return {"type": "resume_task_request", "for_task": name, "for_tokens": list(tokens)}


@pytest.fixture
def client() -> DeskClient:
    return DeskClient()


@pytest.fixture
def api(client: DeskClient) -> TaskApi:
    return TaskApi(client, "depot", lambda: 5, OwnErrors("rmf"))


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
    asked(api, resume("one", interrupted["token"]))
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
        ("[]", 422, "a request is an object, a list was sent", True),
        ("null", 422, "a request is an object, null was sent", True),
        ("3", 422, "a request is an object, the number 3 was sent", True),
        ({}, 422, "it has no field `type`; answered are", True),
        ({"type": None}, 422, "its type is None", True),
        ("{" + " " * (1 << 20) + "}", 413, "a request has at most 1048576 bytes", True),
        ({"type": "resume_task_request"}, 422, "for_task is missing", True),
        (
            {"type": "resume_task_request", "for_task": "one"},
            422,
            "for_tokens is missing: send the id of the task, and the tokens of the",
            True,
        ),
        (resume("one", "never given"), 404, "'never given' is not an interruption of 'one'", False),
        (dispatch(labels=["id="]), 422, "no id stands behind 'id='", True),
        (dispatch(labels=["id=a", "id=b"]), 422, "id=a and id=b are two ids", True),
        (dispatch(description="shelf_1"), 422, "an argument by each name", True),
        (dispatch(fleet_name="other"), 422, "fleet_name 'other': this is the fleet 'depot'", True),
        (dispatch(unix_millis_earliest_start_time=10**30), 422, "not a time in this era", True),
        (
            dispatch(unix_millis_earliest_start_time=1_900_000_000_000),
            409,
            "unix_millis_earliest_start_time: at most a year from now",
            False,
        ),
        (dispatch(description={"where": "moon"}), 422, "where is one of dock_1", False),
        (dispatch(category="paint"), 422, "no job type 'paint'; known: deliver, inspect", False),
        (dispatch(labels=["id=silent"]), 504, "D1 does not answer", False),
        (
            dispatch(unix_millis_request_time=-1),
            422,
            "request_time is not a time in this era",
            True,
        ),
        (dispatch(labels=["l" * 100] * 50), 422, "labels: at most 4096 characters in all", True),
        (dispatch(priority={"type": "binary", "value": 2}), 422, "the value 0 or 1", True),
        (dispatch(priority={"value": "high"}), 422, '{"type": "binary", "value": 0 or 1}', True),
        (dispatch(priority={"value": 1 << 64}), 422, "a priority is a whole number from", False),
        (dispatch(category="\ud800"), 422, "no job type", False),
        (dispatch(description={"where": "\ud800"}), 422, "where is one of", False),
        (dispatch(description={"\ud800": 1}), 422, "takes the arguments where", False),
        (dispatch(description={"where": 10**400}), 422, "has too many digits", False),
        (dispatch(labels=["id=\ud800"]), 422, "is not an id", False),
        ({"type": "interrupt_task_request", "task_id": "\ud800"}, 404, "no job", False),
        ({"type": "cancel_task_request", "task_id": "x" * 100_000}, 404, "no job", False),
        (resume("\ud800", "t"), 404, "is not an interruption of", False),
        ('{"type": "task_log_request", "task_id": NaN}', 422, "it is not JSON", True),
        (direct(fleet="other"), 422, "fleet 'other': this is the fleet 'depot'", True),
        (direct(robot="D9"), 404, "no robot 'D9'; known: D1", False),
        (direct(), 422, "the team decides which robot does a task", True),
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
    assert answer["errors"][0]["category"] == HTTPStatus(code).phrase


def test_a_task_resumes_when_all_its_interruptions_are_discarded(api: TaskApi) -> None:
    same = dispatch()
    asked(api, same)

    def interrupt() -> str:
        token: str = asked(api, {"type": "interrupt_task_request", "task_id": "one"})[0]["token"]
        return token

    def status() -> str:
        found: str = asked(api, same)[0]["state"]["status"]
        return found

    first, second, third = interrupt(), interrupt(), interrupt()
    assert len({first, second, third}) == 3
    refused, _ = asked(api, resume("one", first, "never given"))
    assert not refused["success"]
    asked(api, resume("one", first, second))
    assert status() == "standby"
    assert not asked(api, resume("one", second))[0]["success"], "that is discarded"
    asked(api, resume("one", third))
    assert status() == "queued"
    again = interrupt()
    assert status() == "standby"
    asked(api, resume("one", again))
    assert status() == "queued"


def test_interruptions_are_bounded(api: TaskApi, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requests, "MAX_INTERRUPTIONS", 2)
    asked(api, dispatch())
    interrupt = {"type": "interrupt_task_request", "task_id": "one"}
    answer, _ = asked(api, interrupt, interrupt, interrupt)
    assert (answer["success"], answer["errors"][0]["code"]) == (False, 503)


def test_whole_numbers_may_have_a_fraction_of_zero(client: DeskClient, api: TaskApi) -> None:
    deliver = {"shelf": "shelf_1", "dock": "dock_1", "boxes": 3.0}
    priority = {"type": "value", "value": 7.0}
    asked(api, dispatch(category="deliver", description=deliver, priority=priority))
    (row,) = client.jobs
    assert (row.arguments, row.priority) == (deliver | {"boxes": 3}, 7)
    assert isinstance(row.arguments["boxes"], int)


@pytest.mark.parametrize(
    "message",
    [
        dispatch(),
        {"type": "interrupt_task_request", "task_id": "one"},
        {"type": "cancel_task_request", "task_id": "one"},
    ],
)
def test_without_robots_a_request_is_refused_at_once(
    client: DeskClient, api: TaskApi, message: Any
) -> None:
    client.watcher.observer.membership.members = dict  # type: ignore[method-assign]
    answer, wrong = asked(api, message)
    assert (answer["errors"][0]["code"], wrong) == (503, "")
    assert answer["errors"][0]["detail"] == "no robot of the team is heard"


async def test_requests_about_one_task_take_turns(
    api: TaskApi, monkeypatch: pytest.MonkeyPatch
) -> None:
    submits, order = TeamClient.submit, []
    may_go_on = anyio.Event()

    async def slow(*given: Any, **more: Any) -> Any:
        await may_go_on.wait()
        order.append("dispatch")
        return await submits(*given, **more)

    async def ask(message: Any, name: str) -> None:
        await api.answer(json.dumps(message))
        order.append(name)

    monkeypatch.setattr(TeamClient, "submit", slow)
    async with anyio.create_task_group() as group:
        group.start_soon(ask, dispatch(), "dispatched")
        await anyio.wait_all_tasks_blocked()
        group.start_soon(ask, {"type": "cancel_task_request", "task_id": "one"}, "cancelled")
        group.start_soon(ask, {"type": "task_log_request", "task_id": "other"}, "other")
        await anyio.wait_all_tasks_blocked()
        may_go_on.set()
    assert order == ["other", "dispatch", "dispatched", "cancelled"]


def test_the_types_of_jobs_are_discovered(api: TaskApi) -> None:
    answer, _ = asked(api, {"type": "task_discovery_request"})
    tasks = {task["category"]: task["description_schema"] for task in answer["data"]["tasks"]}
    assert sorted(tasks) == ["deliver", "inspect"]
    boxes = tasks["deliver"]["properties"]["boxes"]
    assert boxes == {"type": "integer", "minimum": 1, "maximum": 4}


@pytest.mark.parametrize("kind", ["activity_discovery_request", "activitiy_discovery_request"])
def test_activities_are_discovered_by_both_spellings(api: TaskApi, kind: str) -> None:
    answer, wrong = asked(api, {"type": kind})
    assert (answer, wrong) == ({"data": [{"fleet_name": "depot", "activities": []}]}, "")


@pytest.mark.parametrize("name", REQUESTS)
def test_the_type_that_a_schema_gives_is_answered(api: TaskApi, name: str) -> None:
    """What its own text says, not what its file is called."""
    known = ALL[name]["properties"]["type"]
    kind = known["enum"][0] if "enum" in known else known.get("const", known.get("constant", name))
    _, wrong = asked(api, {"type": kind})
    assert "its type is" not in wrong


def test_the_priorities_of_rmf_web(client: DeskClient, api: TaskApi) -> None:
    """It sends 1 for a task that goes first, and 0 for others."""
    types = MISSION.jobs
    for value, wanted in ((0, types["inspect"].priority), (1, 1 + types["deliver"].priority)):
        given = {"type": "binary", "value": value}
        same = dispatch(labels=[f"id=job-{value}"], priority=given, unix_millis_request_time=1_000)
        booking = asked(api, same)[0]["state"]["booking"]
        assert (booking["priority"], booking["unix_millis_request_time"]) == (given, 1_000)
        assert asked(api, same)[0]["success"], "the same task again"
        (row,) = [row for row in client.jobs if row.id == f"job-{value}"]
        assert row.priority == wanted


def test_a_requester_is_bounded_and_printable(api: TaskApi) -> None:
    answer, _ = asked(api, dispatch(requester="a\nb\ud800" + "c" * 9_000))
    assert answer["state"]["booking"]["requester"] == "a?b?" + "c" * 636


def test_an_error_of_the_program_is_the_answer_to_its_request_alone(
    api: TaskApi, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def fail(*_: Any, **__: Any) -> None:
        raise OverflowError("Integer value out of range")

    monkeypatch.setattr(TeamClient, "submit", fail)
    answer, wrong = asked(api, dispatch())
    assert (answer["errors"][0]["code"], wrong) == (
        500,
        "OverflowError: Integer value out of range",
    )
    assert "Integer value out of range" in capsys.readouterr().err
    assert not asked(api, {"type": "cancel_task_request", "task_id": "two"})[1]


@given(st.data())
def test_any_request_has_a_valid_answer_and_is_wrong_only_if_its_schema_or_the_text_says_so(
    data: st.DataObject,
) -> None:
    api = TaskApi(DeskClient(), "depot", lambda: 5, OwnErrors("rmf"))
    asked(api, dispatch())
    name = data.draw(st.sampled_from(REQUESTS))
    message = data.draw(
        messages(ALL[name]).flatmap(perhaps_wrong)
        | st.builds(lambda task: {"type": name, "task_id": task, "for_task": task}, IDS)
        | st.builds(lambda request: {"type": name, "request": request}, DISPATCHES)
    )
    answer, wrong = asked(api, message)
    is_respelt = isinstance(message, dict) and message.get("type") == "activity_discovery_request"
    if not validator(name).is_valid(message) and not is_respelt:
        assert wrong
        assert answer["errors"][0]["code"] == 422
