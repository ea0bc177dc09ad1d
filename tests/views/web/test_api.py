"""The API's answers to what cannot be done, and what is served only to the page itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

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
