"""The API's answers to what cannot be done, and what is served only to the page itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import anyio
import pytest
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.testclient import TestClient

from mrbt_mesh.core.agent import job_desk
from mrbt_mesh.views.web.access import Role
from mrbt_mesh.views.web.api import MAX_BODY_BYTES, Api
from tests.support.one_robot import DeskClient

JOB = {"type": "inspect", "arguments": {"where": "shelf_1"}}


def anna(_: Request, __: Role) -> str:
    return "anna"


def guest(_: Request, role: Role) -> str:
    if role == "operator":
        raise HTTPException(403, "a guest")
    return "guest"


def page(access: Callable[[Request, Role], str] = anna) -> TestClient:
    return TestClient(Api(DeskClient(), None, access).application())  # type: ignore[arg-type]


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
        (JOB | {"id": "a b"}, 422, "'a b' is no id"),
        (JOB | {"safe": 0}, 422, "safe: Input should be greater than or equal to 1"),
        (JOB | {"not_before": "tomorrow"}, 422, "not_before"),
        ({"arguments": {}}, 422, "type: Field required"),
        (JOB | {"not_before": "P999999Y"}, 422, "not_before: at most a year from now"),
        (JOB | {"deadline": "P2Y"}, 422, "deadline: at most a year from now"),
        (JOB | {"not_before": "9999-12-31T23:59:59Z"}, 422, "not_before: at most a year"),
        (JOB | {"not_before": "0001-01-01T00:00:00Z"}, 422, "not_before: before 1970"),
        (JOB | {"priority": 1 << 70}, 422, "a priority is a whole number from"),
        ("x" * MAX_BODY_BYTES, 413, f"the body is longer than {MAX_BODY_BYTES} bytes"),
    ],
)
def test_a_wrong_job_is_a_problem_with_its_remedy(body: Any, status: int, text: str) -> None:
    answer = page().post("/jobs", json=body)
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, answer.json()["status"]) == (status, status)
    assert text in answer.json()["detail"]


def test_too_many_open_jobs_are_a_reason_to_ask_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_desk, "MAX_OPEN", 1)
    client = page()
    assert client.post("/jobs", json=JOB).status_code == 201
    answer = client.post("/jobs", json=JOB)
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
    assert "1 jobs are open" in answer.json()["detail"]


def test_other_paths_and_methods_are_problems_too() -> None:
    for method, path, status in (("GET", "/none", 404), ("DELETE", "/jobs", 405)):
        answer = page().request(method, path)
        assert (answer.status_code, answer.json()["status"]) == (status, status)


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
