"""The OpenAPI 3.1 description of the HTTP API, with the schemas that its routes use."""

from __future__ import annotations

from collections.abc import Iterable
from http import HTTPStatus
from typing import Any

from pydantic import TypeAdapter

from mrbt_mesh.core.mission.job_arguments import is_exact_number
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.job_rows import JobRow
from mrbt_mesh.runtime.team_client import CURSOR_PATTERN
from mrbt_mesh.version import __version__
from mrbt_mesh.views.model.job_types import (
    JobTypeView,
    ParameterView,
    arguments_schema,
    job_types,
)
from mrbt_mesh.views.web.api import (
    CHANGES,
    MAX_EVENTS,
    MAX_PAGE,
    ORDERS,
    STATES,
    Acknowledgement,
    HoldRequest,
    Nothing,
    OrderAcknowledgement,
    Priority,
    Submission,
)
from mrbt_mesh.views.web.number_pattern import range_pattern

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
_CURSOR = {"type": "string", "pattern": f"^{CURSOR_PATTERN}$"}
_STATEMENT = {
    "type": "object",
    "required": ["level", "text"],
    "properties": {"level": {"enum": ["bad", "warn", "info", "good"]}, "text": _TEXT},
}
_PROBLEM = {
    "description": "Problem details (RFC 9457). `detail` says what would be right.",
    "type": "object",
    "required": ["type", "title", "status", "detail"],
    "properties": {
        "type": {"const": "about:blank"},
        "title": _TEXT,
        "status": {"type": "integer"},
        "detail": _TEXT,
    },
}
_TASK = {
    "type": "object",
    "required": ["status", "robots"],
    "properties": {"status": _TEXT, "robots": {"type": "array", "items": _TEXT}},
}
_ROBOT = {
    "type": "object",
    "required": [
        *("state", "type", "local_task", "global_task", "phase", "lost", "problems"),
        *("at_work_s", "expected_s", "is_overdue"),
    ],
    "properties": {
        "state": {"enum": ["alive", "suspect", "dead", "left"]},
        **{n: {"type": ["string", "null"]} for n in ("type", "local_task", "global_task", "phase")},
        **{n: {"type": "object"} for n in ("lost", "problems")},
        "at_work_s": {
            "type": ["number", "null"],
            "description": "For how long its action has run; null: none runs, or it is not known.",
        },
        "expected_s": {
            "type": ["number", "null"],
            "description": "How long that action should take, if the mission says so.",
        },
        "is_overdue": {
            "type": "boolean",
            "description": "Whether it takes more than three times as long.",
        },
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
        "over": {
            "type": "boolean",
            "description": "Whether the run has its result, or no robot of it is left.",
        },
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


_JOB_ID = {"type": "string", "pattern": r"^(?!\.{1,2}$)[A-Za-z0-9_.+-]{1,64}$"}
_LOCATION = {"Location": {"description": "Where the job is.", "schema": _TEXT}}
_LINK = {
    "Link": {
        "description": 'Where the next ones are, if there are any: `<...>; rel="next"` (RFC 8288).',
        "schema": _TEXT,
    }
}
_EVENTS = (
    "Server-sent events: `begin` with everything, then `news`, and `over` when the result of the "
    "run is known, no robot of it is left, or the server ends. The stream ends with `over`, or "
    "after `limit` events. A client that reads a whole answer asks for one event at a time, and "
    "gives the id of the last one: the next answer waits until something has changed, a second at "
    "most."
)


def openapi(
    has_tokens: bool, public_url: str = "", mission: Mission | None = None
) -> dict[str, Any]:
    """Return the description of a server, with or without tokens.

    With a `mission` it tells what may be submitted, by job type.
    """
    schemas = {name: _schema(model) for name, model in MODELS.items()}
    if mission is not None:
        _describe_types(schemas["Submission"], mission)
    schemas["Job"]["properties"]["state"] = {"enum": list(STATES)}
    written = {"Status": _STATUS, "News": _NEWS, "Problem": _PROBLEM}
    states = {"type": "array", "items": {"enum": list(STATES)}}
    filtered = _parameter("state", states, "Only these.")
    limit = _parameter("limit", _numbers(MAX_PAGE), "At most so many; none: all.")
    cursor = _parameter("cursor", _CURSOR, "Those after this place: of `Link` in an answer.")
    last = _parameter("Last-Event-ID", _TEXT, "Only what has changed since this event.", "header")
    count = _parameter("limit", _numbers(MAX_EVENTS), "End after so many events; none: go on.")
    # Some programs apply the schema to the whole text, others to each event.
    data = {"type": "string", "contentMediaType": "application/json", "contentSchema": _ref("News")}
    event = {
        "type": "object",
        "properties": {"id": _TEXT, "event": _TEXT, "data": data},
        "required": ["data"],
    }
    events = {"text/event-stream": {"schema": {"anyOf": [_TEXT, event]}}}
    paths: dict[str, Any] = {
        "/v1/status": {"get": _operation("get_status", "The team and its robots", _ref("Status"))},
        "/v1/job-types": {
            "get": _operation("get_job_types", "The types of jobs", _list("JobType"))
        },
        "/v1/jobs": {
            "get": _operation(
                "get_jobs",
                "The jobs that are known",
                _list("Job"),
                parameters=[filtered, limit, cursor],
                headers=_LINK,
            ),
            "post": _operation(
                "submit_job",
                "Submit a job",
                _ref("Acknowledgement"),
                201,
                "Submission",
                (403, 409, 504),
                headers=_LOCATION,
            ),
        },
        "/v1/jobs/{id}": {"get": _operation("get_job", "One job", _ref("Job"), problems=(404,))},
        "/v1/events": {
            "get": _operation("get_events", "What changes", events, parameters=[last, count])
            | {"description": _EVENTS}
        },
    }
    for change in CHANGES:
        body = {"priority": "Priority", "hold": "HoldRequest"}.get(change, "Nothing")
        # 405, since clients resolve `.` in the path.
        answer, problems = _ref("Acknowledgement"), (403, 404, 405, 409, 504)
        name, text = (
            f"{change}_job" if change != "priority" else "set_job_priority",
            SUMMARIES[change],
        )
        made = _operation(name, text, answer, body=body, problems=problems)
        paths[f"/v1/jobs/{{id}}/{change}"] = {"post": made}
    for order in ORDERS:
        answer, text = _ref("OrderAcknowledgement"), ORDER_SUMMARIES[order]
        made = _operation(f"{order}_team", text, answer, body="Nothing", problems=(403, 504))
        paths[f"/v1/{order}"] = {"post": made}
    for path, item in paths.items():
        if "{id}" in path:
            item["parameters"] = [{"name": "id", "in": "path", "required": True, "schema": _JOB_ID}]
    token = {
        "type": "http",
        "scheme": "bearer",
        "description": "A token of a server that is started with --tokens; others need none.",
    }
    return {
        "openapi": "3.1.0",
        "info": {"title": "mrbt-mesh", "version": __version__},
        "paths": paths,
        **({"servers": [{"url": public_url}]} if public_url else {}),
        "security": [{"token": []}] if has_tokens else [],
        "components": {"schemas": schemas | written, "securitySchemes": {"token": token}},
    }


def _schema(model: Any) -> dict[str, Any]:
    place = "#/components/schemas/{model}"
    schema = TypeAdapter(model).json_schema(ref_template=place)
    found: dict[str, Any] = _inlined(schema, schema.pop("$defs", {}))
    return found


def _inlined(value: Any, known: dict[str, Any]) -> Any:
    """Replace references in a schema with its own definitions."""
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


def _describe_types(submission: dict[str, Any], mission: Mission) -> None:
    """Describe the job types and, by `if`, `then` and `else`, the arguments of each."""
    properties = submission["properties"]
    properties["type"] |= {"enum": sorted(mission.jobs)}
    properties["safe"] |= {"minimum": 1, "maximum": len(mission.robots)}
    place = submission
    for kind in job_types(mission):
        place["if"] = {"properties": {"type": {"const": kind.name}}}
        needed = {"required": ["arguments"]} if kind.parameters else {}
        place["then"] = {"properties": {"arguments": _arguments(kind)}, **needed}
        place["else"] = place = {}


def _arguments(kind: JobTypeView) -> dict[str, Any]:
    """Return the schema of a job's arguments: by parameter name, or in order."""
    count, values = len(kind.parameters), {each.name: _value(each) for each in kind.parameters}
    listed: dict[str, Any] = {"type": "array", "minItems": count, "maxItems": count}
    if count:  # it may not be empty
        listed |= {"prefixItems": list(values.values()), "items": False}
    return {"anyOf": [arguments_schema(kind) | {"properties": values}, listed]}


def _value(parameter: ParameterView) -> dict[str, Any]:
    """Return the schema of a value; a number and its text are the same argument."""
    if parameter.min is None or parameter.max is None:
        texts = parameter.choices
        return {"enum": [*texts, *(int(each) for each in texts if is_exact_number(each))]}
    number = {"type": "integer", "minimum": parameter.min, "maximum": parameter.max}
    pattern = range_pattern(parameter.min, parameter.max)
    return {"anyOf": [number, {"type": "string", "pattern": pattern}]}


def _numbers(most: int) -> dict[str, Any]:
    return {"type": "integer", "minimum": 1, "maximum": most}


def _parameter(
    name: str, schema: dict[str, Any], description: str, where: str = "query"
) -> dict[str, Any]:
    return {"name": name, "in": where, "schema": schema, "description": description}


def _operation(
    name: str,
    summary: str,
    answer: dict[str, Any],
    status: int = 200,
    body: str = "",
    problems: Iterable[int] = (),
    parameters: list[Any] | None = None,
    headers: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Describe an operation.

    `answer` is a JSON schema, or a whole content. 401, 421, 422 and 503 are always possible.
    """
    content = answer if "text/event-stream" in answer else _json(answer)
    answers: dict[str, Any] = {str(status): {"description": summary, "content": content}}
    if headers:
        answers[str(status)]["headers"] = headers
    for each in sorted({401, 421, 422, 503, *((413, 415) if body else ()), *problems}):
        problem = {"application/problem+json": {"schema": _ref("Problem")}}
        answers[str(each)] = {"description": HTTPStatus(each).phrase, "content": problem}
    made: dict[str, Any] = {"operationId": name, "summary": summary, "responses": answers}
    if body:
        is_needed = body in ("Submission", "Priority")
        made["requestBody"] = {"content": _json(_ref(body)), "required": is_needed}
    return made | ({"parameters": parameters} if parameters else {})
