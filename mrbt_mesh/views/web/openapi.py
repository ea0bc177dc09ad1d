"""The OpenAPI 3.1 description of the HTTP API, with the schemas of what its routes use."""

from __future__ import annotations

from collections.abc import Iterable
from http import HTTPStatus
from typing import Any

from pydantic import TypeAdapter

from mrbt_mesh.core.observer.job_rows import JobRow
from mrbt_mesh.version import __version__
from mrbt_mesh.views.model.job_types import JobTypeView
from mrbt_mesh.views.web.api import (
    CHANGES,
    ORDERS,
    STATES,
    Acknowledgement,
    HoldRequest,
    Nothing,
    OrderAcknowledgement,
    Priority,
    Submission,
)

MODELS = {
    "Job": JobRow,
    "JobType": JobTypeView,
    "Acknowledgement": Acknowledgement,
    "OrderAcknowledgement": OrderAcknowledgement,
    "HoldRequest": HoldRequest,
    "Submission": Submission,
    "Priority": Priority,
    "Nothing": Nothing,
}
SUMMARIES = {
    "cancel": "Cancel a job; what is being done is stopped",
    "hold": "Hold a job until it is released; no further step of it begins",
    "release": "Release a job that is held",
    "priority": "Give a job another priority",
}
ORDER_SUMMARIES = {
    "pause": "Stop all work until it is resumed",
    "resume": "Go on with the work",
    "abort": "End the mission as failed",
}
_TEXT = {"type": "string"}
_STATEMENT = {
    "type": "object",
    "required": ["level", "text"],
    "properties": {"level": {"enum": ["bad", "warn", "info", "good"]}, "text": _TEXT},
}
_PROBLEM = {
    "type": "object",
    "required": ["title", "status", "detail"],
    "properties": {"title": _TEXT, "status": {"type": "integer"}, "detail": _TEXT},
}
_TASK = {
    "type": "object",
    "required": ["status", "robots"],
    "properties": {"status": _TEXT, "robots": {"type": "array", "items": _TEXT}},
}
_ROBOT = {
    "type": "object",
    "required": ["state", "type", "local_task", "global_task", "phase", "lost", "problems"],
    "properties": {
        "state": {"enum": ["alive", "suspect", "dead", "left"]},
        **{n: {"type": ["string", "null"]} for n in ("type", "local_task", "global_task", "phase")},
        **{n: {"type": "object"} for n in ("lost", "problems")},
    },
}
_STATUS = {
    "description": "What `mrbt status --json` prints.",
    "type": "object",
    "required": ["mission", "headline", "result", "robots", "global_tasks", "agreement"],
    "properties": {
        "mission": _TEXT,
        "headline": {"type": "array", "items": _STATEMENT},
        "result": {"type": ["string", "null"]},
        "agreement": {"type": "boolean"},
        "robots": {"type": "object", "additionalProperties": _ROBOT},
        "global_tasks": {"type": "object", "additionalProperties": _TASK},
    },
}
_NEWS = {
    "description": (
        "The data of an event. `begin` has all items, `news` those that have changed since the "
        "event of Last-Event-ID, `over` ends the stream. Items are `headline`, `team`, `robot/ID`, "
        "`job/ID`, `task/NAME` and others; null: it is no more."
    ),
    "type": "object",
    "required": ["now_s", "run", "items"],
    "properties": {
        "now_s": {"type": ["number", "null"], "description": "Seconds since the run has begun."},
        "run": _TEXT,
        "items": {
            "type": "object",
            "patternProperties": {
                "^headline$": {"type": "array", "items": _STATEMENT},
                "^job/": {"oneOf": [{"$ref": "#/components/schemas/Job"}, {"type": "null"}]},
            },
        },
    },
}


def openapi(has_tokens: bool) -> dict[str, Any]:
    """The description of a server that asks for tokens, or that does not."""
    schemas = {name: _schema(model) for name, model in MODELS.items()}
    written = {"Status": _STATUS, "News": _NEWS, "Problem": _PROBLEM}
    states = {"type": "array", "items": {"enum": list(STATES)}}
    filtered = {"name": "state", "in": "query", "schema": states, "description": "Only these."}
    last = {"name": "Last-Event-ID", "in": "header", "schema": _TEXT}
    events = {"text/event-stream": {"schema": {"type": "string"}, "x-data": _ref("News")}}
    paths: dict[str, Any] = {
        "/v1/status": {"get": _operation("The team and its robots", _ref("Status"))},
        "/v1/job-types": {"get": _operation("The types of jobs", _list("JobType"))},
        "/v1/jobs": {
            "get": _operation("The jobs that are known", _list("Job"), parameters=[filtered]),
            "post": _operation(
                "Submit a job", _ref("Acknowledgement"), 201, "Submission", (403, 409, 422, 504)
            ),
        },
        "/v1/jobs/{id}": {"get": _operation("One job", _ref("Job"), problems=(404,))},
        "/v1/events": {"get": _operation("What changes", events, parameters=[last])},
    }
    for change in CHANGES:
        body = {"priority": "Priority", "hold": "HoldRequest"}.get(change, "Nothing")
        problems = (403, 404, 409, 422, 504)
        made = _operation(SUMMARIES[change], _ref("Acknowledgement"), body=body, problems=problems)
        paths[f"/v1/jobs/{{id}}/{change}"] = {"post": made}
    for order in ORDERS:
        answer, text = _ref("OrderAcknowledgement"), ORDER_SUMMARIES[order]
        made = _operation(text, answer, body="Nothing", problems=(403, 422, 504))
        paths[f"/v1/{order}"] = {"post": made}
    for path, item in paths.items():
        if "{id}" in path:
            item["parameters"] = [{"name": "id", "in": "path", "required": True, "schema": _TEXT}]
    tokens = {"securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}}
    return {
        "openapi": "3.1.0",
        "info": {"title": "mrbt-mesh", "version": __version__},
        "paths": paths,
        "security": [{"token": []}] if has_tokens else [],
        "components": {"schemas": schemas | written, **(tokens if has_tokens else {})},
    }


def _schema(model: Any) -> dict[str, Any]:
    place = "#/components/schemas/{model}"
    schema = TypeAdapter(model).json_schema(ref_template=place)
    found: dict[str, Any] = _inlined(schema, schema.pop("$defs", {}))
    return found


def _inlined(value: Any, known: dict[str, Any]) -> Any:
    """A schema with its own definitions in place of references to them."""
    if isinstance(value, dict):
        if "$ref" in value:
            return _inlined(known[value["$ref"].rpartition("/")[2]], known)
        return {key: _inlined(each, known) for key, each in value.items()}
    return [_inlined(each, known) for each in value] if isinstance(value, list) else value


def _ref(name: str) -> dict[str, Any]:
    return {"$ref": f"#/components/schemas/{name}"}


def _list(name: str) -> dict[str, Any]:
    return {"type": "array", "items": _ref(name)}


def _json(schema: dict[str, Any]) -> dict[str, Any]:
    return {"application/json": {"schema": schema}}


def _operation(
    summary: str,
    answer: dict[str, Any],
    status: int = 200,
    body: str = "",
    problems: Iterable[int] = (),
    parameters: list[Any] | None = None,
) -> dict[str, Any]:
    """`answer`: a schema of JSON, or a whole content. 401 and 503 are possible everywhere."""
    content = answer if "text/event-stream" in answer else _json(answer)
    answers: dict[str, Any] = {str(status): {"description": summary, "content": content}}
    for each in sorted({401, 503, *problems}):
        problem = {"application/problem+json": {"schema": _ref("Problem")}}
        answers[str(each)] = {"description": HTTPStatus(each).phrase, "content": problem}
    made: dict[str, Any] = {"summary": summary, "responses": answers}
    if body:
        made["requestBody"] = {"content": _json(_ref(body)), "required": body != "Nothing"}
    return made | ({"parameters": parameters} if parameters else {})
