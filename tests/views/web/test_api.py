"""The API's answers to what cannot be done, and what is served only to the page itself."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import anyio
import pytest
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.testclient import TestClient

from mrbt_mesh.core.agent import job_desk
from mrbt_mesh.views.web.access import Role
from mrbt_mesh.views.web.api import CHANGES, Api
from mrbt_mesh.views.web.bodies import MAX_BODY_BYTES
from tests.support.one_robot import DeskClient

JOB = {"type": "inspect", "arguments": {"where": "shelf_1"}}


def anna(_: Request, __: Role) -> str:
    return "anna"


def guest(_: Request, role: Role) -> str:
    if role == "operator":
        raise HTTPException(403, "a guest")
    return "guest"


def page(access: Callable[[Request, Role], str] = anna) -> TestClient:
    return of(DeskClient(), access)


def of(client: DeskClient, access: Callable[[Request, Role], str] = anna) -> TestClient:
    return TestClient(Api(client, None, access).application())  # type: ignore[arg-type]


def test_the_name_of_the_caller_is_the_operator_of_a_job() -> None:
    client = page()
    answer = client.post("/jobs", json=JOB | {"id": "one"})
    assert (answer.status_code, answer.headers["location"]) == (201, "/jobs/one")
    assert client.get("/jobs/one").json()["operator"] == "anna"
    assert page(guest).post("/jobs", json=JOB).status_code == 403
    assert page(guest).post("/jobs/one/cancel").status_code == 403


@pytest.mark.parametrize(
    ("body", "status", "text"),
    [
        (JOB | {"id": "silent"}, 504, "D1 does not answer"),
        (JOB | {"id": "a b"}, 422, "'a b' is not an id"),
        (
            JOB | {"safe": 0},
            422,
            "safe: a whole number of at least 1 is expected",
        ),
        (JOB | {"not_before": "tomorrow"}, 422, "not_before: a time (2026-"),
        (JOB | {"id": "."}, 422, "'.' is not an id"),
        (JOB | {"id": ".."}, 422, "'..' is not an id"),
        (JOB | {"id": "a" * 5_000}, 422, "is not an id"),
        (JOB | {"priority": 1.5}, 422, "priority: a whole number is expected"),
        (JOB | {"priority": "9"}, 422, "priority: a whole number is expected, the text '9' was"),
        (JOB | {"priority": 10**4_000}, 422, "a priority is a whole number from"),
        (JOB | {"arguments": {"where": 10**400}}, 422, "where: the number has too many digits"),
        (JOB | {"arguments": {"where": "s" * 60_000}}, 422, "where is one of dock_1"),
        (JOB | {"arguments": {"where": "shelf_1\0"}}, 422, "where is one of dock_1"),
        (JOB | {"arguments": {"where": 1.5}}, 422, "1.5 is neither a text nor a whole number"),
        (JOB | {"arguments": {"where": None}}, 422, "null is neither a text nor a whole number"),
        (JOB | {"arguments": []}, 422, "inspect takes 1 argument (where); given: 0"),
        (JOB | {"arguments": ["moon"]}, 422, "where is one of dock_1"),
        (JOB | {"arguments": "shelf_1"}, 422, "arguments: an object or a list is expected, the"),
        (JOB | {"arguments": None}, 422, "arguments: an object or a list is expected, null was"),
        (JOB | {"priorty": 1}, 422, "priorty: there is no such field; did you mean 'priority'?"),
        ([], 422, "the body: an object is expected, a list was sent"),
        (JOB | {"id": {}}, 422, "id: a text is expected, an object was sent"),
        ({"arguments": {}}, 422, "type: it is missing"),
        (JOB | {"not_before": "P999999Y"}, 409, "not_before: at most a year from now"),
        (JOB | {"deadline": "P2Y"}, 409, "deadline: at most a year from now"),
        (
            JOB | {"not_before": "9999-12-31T23:59:59Z"},
            409,
            "not_before: give a time that is at most a year",
        ),
        (JOB | {"not_before": "0001-01-01T00:00:00Z"}, 409, "not_before: before 1970"),
        (JOB | {"priority": 1 << 70}, 422, "a priority is a whole number from"),
        ("x" * MAX_BODY_BYTES, 413, f"the body is longer than {MAX_BODY_BYTES} bytes"),
    ],
)
def test_a_wrong_job_is_a_problem_with_its_remedy(body: Any, status: int, text: str) -> None:
    answer = page().post("/jobs", json=body)
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, answer.json()["status"]) == (status, status)
    assert text in answer.json()["detail"]


def test_a_field_that_is_given_twice_is_refused() -> None:
    body = b'{"type": "inspect", "arguments": {"where": "shelf_1", "where": "shelf_2"}}'
    answer = page().post("/jobs", content=body, headers={"content-type": "application/json"})
    assert (answer.status_code, answer.json()["detail"]) == (422, "'where' is given twice")


def test_null_is_called_so() -> None:
    headers = {"content-type": "application/json"}
    detail = page().post("/jobs", content="null", headers=headers).json()["detail"]
    assert detail == "the body: an object is expected, null was sent"


@pytest.mark.parametrize("text", ["", "{", '{"type": "\\ud800"}', "[" * 50_000, "[" + "9" * 5_000])
def test_what_is_no_json_is_said_to_be_none(text: str) -> None:
    answer = page().post("/jobs", content=text, headers={"content-type": "application/json"})
    assert answer.status_code == 422
    assert ("type: it is missing" if not text else "the body is not JSON") in answer.json()[
        "detail"
    ]


@pytest.mark.parametrize("path", [*(f"/jobs/one/{each}" for each in CHANGES), "/pause", "/resume"])
def test_a_command_needs_no_body_and_takes_one_of_json_alone(path: str) -> None:
    client = page()
    client.post("/jobs", json=JOB | {"id": "one"})
    for media_type in ("text/plain", "application/x-www-form-urlencoded", ""):
        answer = client.post(path, content="a=b", headers={"content-type": media_type})
        assert (answer.status_code, answer.headers["accept"]) == (415, "application/json")
    for headers in ({}, {"content-type": "application/x-www-form-urlencoded"}):
        answer = client.post(path, headers=headers)
        assert answer.status_code == (422 if path.endswith("priority") else 200), answer.text
    body = {"priority": 3} if path.endswith("priority") else {}
    headers = {"content-type": "Application/JSON; charset=utf-8"}
    assert client.post(path, content=json.dumps(body), headers=headers).status_code == 200


@pytest.mark.parametrize(
    ("path", "query"),
    [
        ("/status", "wide=1"),
        ("/jobs", "stat=held"),
        ("/jobs/one", "x"),
        ("/events", "since=1"),
        ("/events", "limit=0"),
        ("/jobs", "limit=1001"),
        ("/jobs", "limit=1&limit=2"),
        ("/jobs", "limit=%C2%B9"),
        ("/jobs", "cursor="),
        ("/jobs", "cursor=0.1.2"),
        ("/jobs", "cursor=0~a"),
        ("/jobs", "cursor=0." + "1" * 17 + "~a"),
        ("/jobs", "cursor=" + "W" * 9_000),
        ("/jobs", "cursor=%F0%9F%A4%96"),
    ],
)
def test_a_query_that_a_request_does_not_take_is_refused(path: str, query: str) -> None:
    answer = page().get(f"{path}?{query}")
    assert (answer.status_code, query.partition("=")[0] in answer.json()["detail"]) == (422, True)


def test_pages_have_every_job_once_also_of_another_server() -> None:
    api = DeskClient()
    for number in range(7):
        job = {"id": f"job+{number}", "priority": number % 2}
        assert of(api).post("/jobs", json=JOB | job).status_code == 201
    of(api).post("/jobs/job+3/cancel")
    everything = [row["id"] for row in of(api).get("/jobs").json()]
    path, found = "/jobs?limit=2", []
    while path:
        answer = of(api).get(path)
        found += [row["id"] for row in answer.json()]
        link = answer.headers.get("link", "")
        assert len(answer.json()) == 2 or not link
        path = link.removeprefix("<").partition(">")[0]
    assert found == everything
    assert sorted(found) == [f"job+{number}" for number in range(7)]
    held = of(api).get("/jobs?state=waiting&state=held&limit=5").headers["link"]
    assert "state=waiting&state=held&limit=5&cursor=" in held
    assert held.endswith('>; rel="next"')


def test_too_many_open_jobs_are_a_reason_to_ask_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_desk, "MAX_OPEN", 1)
    client = page()
    assert client.post("/jobs", json=JOB).status_code == 201
    answer = client.post("/jobs", json=JOB)
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
    assert "1 jobs are open" in answer.json()["detail"]


def test_other_paths_and_methods_are_problems_too() -> None:
    for method, path, status, text in (
        ("GET", "/none", 404, "there is no '/none'; there are /status, /job-types, /jobs, "),
        ("DELETE", "/jobs", 405, "'/jobs' takes no DELETE, but "),
    ):
        answer = page().request(method, path)
        assert (answer.status_code, answer.json()["status"]) == (status, status)
        assert answer.json()["detail"].startswith(text)


@pytest.mark.parametrize(
    ("path", "methods"),
    [
        ("/jobs", "GET HEAD POST"),
        ("/status", "GET HEAD"),
        ("/pause", "POST"),
        ("/jobs/a/hold", "POST"),
    ],
)
def test_which_methods_there_are(path: str, methods: str) -> None:
    for method in ("OPTIONS", "PUT", "TRACE"):
        answer = page().request(method, path)
        assert answer.status_code == 405
        assert sorted(answer.headers["allow"].split(", ")) == methods.split()


@pytest.mark.parametrize("field", ["not_before", "deadline"])
@pytest.mark.parametrize(
    "when",
    [
        *("+600", "600", "14:30", "600:00:00", "1795868000", "+3 days", "3 days", "-PT10M"),
        *("+PT10M", "PT", "P", "P1DT", "PT10", "10M", "2026-05-04", "2026-05-04T14:30:00"),
        *("2026-05-04T14:30+02:00", "2026-05-04 14:30", "2026-13-04T14:30:00Z", "", "pt10m"),
        *("PT1.5H", " PT10M", "PT10M\n", "\u0661", 600, 1.5, True, [], {}),
    ],
)
def test_a_time_is_of_rfc_3339_and_a_duration_of_iso_8601(field: str, when: Any) -> None:
    answer = page().post("/jobs", json=JOB | {field: when})
    assert answer.status_code == 422, when
    assert f"{field}: " in answer.json()["detail"]


@pytest.mark.parametrize("when", ["PT10M", "P1DT2H3M4.5S", "P1W", "PT0.5S", None])
def test_durations_are_counted_from_now(when: str | None) -> None:
    assert page().post("/jobs", json=JOB | {"not_before": when}).status_code == 201


def test_a_state_that_jobs_do_not_have_is_refused() -> None:
    answer = page().get("/jobs", params={"state": "zzz"})
    assert answer.status_code == 422
    assert "state: zzz is none of held, waiting" in answer.json()["detail"]
    assert page().get("/jobs", params={"state": "waiting"}).status_code == 200


def test_a_priority_out_of_range_names_the_range() -> None:
    client = page()
    client.post("/jobs", json=JOB | {"id": "one"})
    answer = client.post("/jobs/one/priority", json={"priority": 1 << 70})
    assert answer.status_code == 422
    assert "a priority is a whole number from" in answer.json()["detail"]


def test_a_client_that_goes_within_a_body_is_no_error() -> None:
    """A server has no log of it, and counts it."""
    api = Api(DeskClient(), None, anna)  # type: ignore[arg-type]
    sent: list[Any] = []

    async def receive() -> dict[str, str]:
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {
        "type": "http",
        "method": "POST",
        "path": "/jobs",
        "raw_path": b"/jobs",
        "root_path": "",
        "query_string": b"",
        "headers": [(b"content-type", b"application/json")],
    }
    anyio.run(api.application(), scope, receive, send)
    assert sent[0]["status"] == 400
