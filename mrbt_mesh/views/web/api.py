"""The HTTP API of a team: its state, its jobs, and what changes as server-sent events.

`mrbt serve` and the live page have the same routes. Errors are problem details (RFC 9457).
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Collection
from dataclasses import asdict
from datetime import datetime, timedelta
from typing import Annotated, Any, Literal, TypeAlias, get_args
from urllib.parse import quote, urlencode

from pydantic import (
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
)
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from mrbt_mesh.cli.commands.operate import nobody
from mrbt_mesh.cli.commands.status import status_data
from mrbt_mesh.core.mission.mission import MAX_PRIORITY, whole
from mrbt_mesh.errors import nearest
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.runtime.watcher import Watcher
from mrbt_mesh.views.model.job_types import job_types
from mrbt_mesh.views.web.access import Access, Role
from mrbt_mesh.views.web.bodies import read_body, sent
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.problem import PROBLEMS, RETRY

MAX_PAGE = 1_000
# The maximum number of stream events per request.
MAX_EVENTS = 100_000
CHANGES = ("cancel", "hold", "release", "priority")
State: TypeAlias = Literal[
    "held", "waiting", "running", "succeeded", "failed", "cancelled", "expired"
]
STATES = get_args(State)
EVENT_STREAM = "text/event-stream"
# Commands to the whole team.
ORDERS = ("pause", "resume", "abort")


# Pydantic alone accepts many other texts, some with meanings that mrbt's own times do not have.
_TIME = re.compile(r"\d{4}-\d\d-\d\d[Tt]\d\d:\d\d:\d\d(\.\d+)?([Zz]|[+-]\d\d:\d\d)", re.ASCII)
_DURATION = re.compile(
    r"P(?=.)(\d+Y)?(\d+M)?(\d+W)?(\d+D)?(T(?=.)(\d+H)?(\d+M)?(\d+(\.\d+)?S)?)?", re.ASCII
)


_PARSER: TypeAdapter[datetime | timedelta] = TypeAdapter(AwareDatetime | timedelta)


def _strict_time(given: Any) -> datetime | timedelta | None:
    if given is None:
        return None
    with contextlib.suppress(ValidationError):
        if isinstance(given, str) and (_TIME.fullmatch(given) or _DURATION.fullmatch(given)):
            return _PARSER.validate_python(given)
    raise ValueError("a time (2026-05-04T14:30:00+02:00) or a duration (PT10M) is expected")


# Possible years: 1970 to 2254.
_YEARS = r"^(19[7-9][0-9]|2[01][0-9]{2}|22[0-4][0-9]|225[0-4])-"
Time: TypeAlias = Annotated[
    AwareDatetime | timedelta | None,
    BeforeValidator(_strict_time),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string", "format": "date-time", "pattern": _YEARS},
                {"type": "string", "format": "duration"},
                {"type": "null"},
            ]
        }
    ),
]


def _object_or_list(given: Any) -> Any:
    """Accept an object or a list; its content is checked by the type of the job."""
    if not isinstance(given, dict | list):
        raise ValueError(f"an object or a list is expected, {sent(given)} was sent")
    return given


Whole: TypeAlias = Annotated[int, BeforeValidator(whole)]
_VALUE: dict[str, Any] = {"type": ["string", "integer"]}
Given: TypeAlias = Annotated[
    dict[str, Any] | list[Any],
    PlainValidator(_object_or_list),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "object", "additionalProperties": _VALUE},
                {"type": "array", "items": _VALUE},
            ]
        }
    ),
]
_PRIORITIES: dict[str, Any] = {"minimum": -MAX_PRIORITY, "maximum": MAX_PRIORITY}


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Submission(_Body):
    """A job to submit. The same `id` again is the same job, at any server of the team."""

    type: str
    arguments: Given = Field(
        default={}, description="An object, parameter -> value, or a list of the values in order."
    )
    id: str = Field(
        default="",
        description="Chosen by the client: 1 to 64 letters, digits, _, ., + or -, and not . or ..; "
        "empty: by the server.",
        json_schema_extra={"pattern": r"^(?!\.{1,2}$)[A-Za-z0-9_.+-]{0,64}$"},
    )
    priority: Whole | None = Field(
        default=None, description="Larger goes first.", json_schema_extra=_PRIORITIES
    )
    not_before: Time = Field(
        default=None,
        description="When it may begin: a time, or how long from now (PT10M); 366 days from now at "
        "most, by the team's clocks.",
    )
    deadline: Time = Field(
        default=None,
        description="When it expires, likewise, and after `not_before`; null: as its type says.",
    )
    safe: Annotated[Whole, Field(ge=1)] | None = Field(
        default=None, description="Answer once this many journals hold it; null: a majority."
    )


class Priority(_Body):
    """A new priority."""

    priority: Whole = Field(json_schema_extra=_PRIORITIES)


class HoldRequest(_Body):
    """Whether what runs of a held job is cancelled, too."""

    now: bool = False


class Nothing(_Body):
    """No more is needed."""


class OrderAcknowledgement(_Body):
    """The team's standing `order`, `robots` whose journals hold it, and `silent` ones."""

    order: Literal["resume", "pause", "abort"]
    robots: list[str]
    silent: list[str]


class Acknowledgement(_Body):
    """A job after a command. `state`: open (it waits or runs), held, how it has ended, or ended if
    that was long ago.
    """

    id: str
    state: Literal["open", "held", "succeeded", "failed", "cancelled", "expired", "ended"]


def client_of_page(watcher: Watcher) -> TeamClient | None:
    """Return the client of a team that takes jobs, else None."""
    if not watcher.observer.mission.jobs:
        return None
    return TeamClient(watcher)


class Api:
    """The routes of the API. `update` of the client and the feed must be called often."""

    def __init__(self, client: TeamClient, feed: Feed, access: Access, prefix: str = "") -> None:
        """`prefix`: what a proxy removes from the front of the paths that clients see."""
        self._client = client
        self._watcher = client.watcher
        self._feed = feed
        self._access = access
        self._prefix = prefix

    def application(self) -> Starlette:
        """Return the ASGI application, without the prefix `/v1`."""
        jobs = self._guarded(self._jobs, "viewer", ("state", "limit", "cursor"))
        submit = self._guarded(self._submit, "operator")

        async def jobs_or_submit(request: Request) -> Response:
            found: Response = await (submit if request.method == "POST" else jobs)(request)
            return found

        routes = [
            Route("/status", self._guarded(self._status)),
            Route("/job-types", self._guarded(self._job_types)),
            Route("/jobs", jobs_or_submit, methods=["GET", "POST"]),
            Route("/jobs/{id}", self._guarded(self._job)),
            Route("/events", self._guarded(self._events, "viewer", ("limit",))),
        ]
        for order in ORDERS:
            endpoint = self._guarded(self._order(order), "operator")
            routes.append(Route(f"/{order}", endpoint, methods=["POST"]))
        for change in CHANGES:
            endpoint = self._guarded(self._change(change), "operator")
            routes.append(Route(f"/jobs/{{id}}/{change}", endpoint, methods=["POST"]))
        made = Starlette(routes=routes, exception_handlers=PROBLEMS)
        made.router.redirect_slashes = False  # it would lead past a proxy
        return made

    def _guarded(
        self,
        answer: Callable[[Request, str], Any],
        role: Role = "viewer",
        parameters: Collection[str] = (),
    ) -> Callable[[Request], Any]:
        """Return an endpoint that checks the caller.

        `parameters` are those that its query may have.
        """

        async def endpoint(request: Request) -> Response:
            caller = self._access(request, role)
            for name in request.query_params:
                if name not in parameters:
                    text = f"{name!r:.80} is not a parameter of this request"
                    raise HTTPException(422, text + nearest(name, parameters))
            if not self._watcher.observer.robots():
                raise HTTPException(503, nobody(self._watcher), RETRY)
            found: Response = await answer(request, caller)
            return found

        return endpoint

    async def _status(self, request: Request, _: str) -> Response:
        return JSONResponse(status_data(self._watcher))

    async def _job_types(self, request: Request, _: str) -> Response:
        return JSONResponse([asdict(each) for each in job_types(self._watcher.observer.mission)])

    async def _jobs(self, request: Request, _: str) -> Response:
        states = request.query_params.getlist("state")
        for state in states:
            if state not in STATES:
                raise HTTPException(422, f"state: {state:.80} is none of {', '.join(STATES)}")
        limit, cursor = _number(request, "limit", MAX_PAGE), request.query_params.get("cursor")
        try:
            rows = self._client.jobs_after(cursor) if cursor is not None else self._client.jobs
        except ValueError:
            text = "cursor: give that of the header `Link` of an earlier answer"
            raise HTTPException(422, text) from None
        rows = [row for row in rows if not states or row.state in states]
        headers, found = {}, rows[:limit]
        if len(found) < len(rows):
            more = [("limit", limit), ("cursor", self._client.cursor_of(found[-1]))]
            query = urlencode([*(("state", state) for state in states), *more])
            headers = {"link": f'<{self._prefix}{request.url.path}?{query}>; rel="next"'}
        return JSONResponse([asdict(row) for row in found], headers=headers)

    async def _job(self, request: Request, _: str) -> Response:
        name = request.path_params["id"]
        row = self._client.job(name)
        if row is None:
            raise HTTPException(404, f"no job {name!r:.80} is known here")
        if row.state not in STATES:
            raise HTTPException(404, f"job {name}: {row.why}")
        return JSONResponse(asdict(row))

    async def _events(self, request: Request, _: str) -> Response:
        return events(request, self._feed, _number(request, "limit", MAX_EVENTS), True)

    async def _submit(self, request: Request, caller: str) -> Response:
        given = await read_body(request, Submission)
        more = given.model_dump(exclude={"type", "arguments", "id"})
        arguments = self._client.arguments_of(given.type, given.arguments)
        self._client.require_robots()
        job = await self._client.submit(
            given.type, *arguments, job_id=given.id, operator=caller, **more
        )
        place = {"location": f"{self._prefix}{request.url.path}/{quote(job.id)}"}
        return JSONResponse({"id": job.id, "state": job.state}, 201, headers=place)

    def _change(self, change: str) -> Callable[[Request, str], Any]:
        async def answer(request: Request, caller: str) -> Response:
            name, priority, wanted = request.path_params["id"], None, change
            if change == "priority":
                priority = (await read_body(request, Priority)).priority
            elif change == "hold":
                wanted = "hold_now" if (await read_body(request, HoldRequest)).now else change
            else:
                await read_body(request, Nothing)
            self._client.require_robots()
            state = await self._client.change(name, wanted, priority, caller)
            return JSONResponse({"id": name, "state": state["state"]})

        return answer

    def _order(self, order: str) -> Callable[[Request, str], Any]:
        async def answer(request: Request, caller: str) -> Response:
            await read_body(request, Nothing)
            self._client.require_robots()
            client = self._client
            give = {"pause": client.pause, "resume": client.resume, "abort": client.abort}[order]
            done = await give(caller)
            data = {"order": done.state["order"], "robots": done.robots, "silent": done.silent}
            return JSONResponse(data)

        return answer


def events(
    request: Request, feed: Feed, limit: int | None = None, ends_with_run: bool = False
) -> Response:
    """Return a feed's stream; it ends after `limit` events, or with the run."""
    headers = {"x-accel-buffering": "no"}  # a proxy such as nginx passes each event on at once
    if request.method == "HEAD":
        return Response(headers=headers, media_type=EVENT_STREAM)
    address = request.client.host if request.client is not None else ""
    last = request.headers.get("last-event-id", "")
    messages = feed.messages(last, address, limit, ends_with_run)
    return StreamingResponse(messages, headers=headers, media_type=EVENT_STREAM)


def _number(request: Request, name: str, most: int) -> int | None:
    """Return a number of the query, None if it is missing. Raises HTTPException 422."""
    given = request.query_params.getlist(name)
    if not given:
        return None
    is_number = len(given) == 1 and re.fullmatch("[0-9]{1,9}", given[0])
    if not is_number or not 1 <= int(given[0]) <= most:
        raise HTTPException(422, f"{name}: a whole number from 1 to {most} is expected")
    return int(given[0])
