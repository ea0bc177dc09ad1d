"""The HTTP API of a team: its state, its jobs, and what changes as server-sent events.

`mrbt serve` and the live page have the same routes. Errors are problem details (RFC 9457).
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from dataclasses import asdict
from datetime import datetime, timedelta
from typing import Annotated, Any, TypeAlias

from pydantic import (
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
)
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from mrbt_mesh.cli.commands.operate import nobody
from mrbt_mesh.cli.commands.status import status_data
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.runtime.watcher import Watcher
from mrbt_mesh.views.model.job_types import job_types
from mrbt_mesh.views.web.access import Access, Role
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.problem import PROBLEMS, RETRY

MAX_BODY_BYTES = 65_536
CHANGES = ("cancel", "hold", "release", "priority")
STATES = ("held", "waiting", "running", "succeeded", "failed", "cancelled", "expired")
# To the whole team.
ORDERS = ("pause", "resume", "abort")


# Pydantic alone takes many other texts, some with a meaning that mrbt's own times do not have.
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


Time: TypeAlias = Annotated[AwareDatetime | timedelta | None, BeforeValidator(_strict_time)]


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Submission(_Body):
    """A job to submit. The same `id` again is the same job, at any server of the team."""

    type: str
    arguments: dict[str, str | int] = {}
    id: str = Field(default="", description="Chosen by the client; empty: by the server.")
    priority: int | None = Field(default=None, description="Larger goes first.")
    not_before: Time = Field(
        default=None, description="When it may begin: a time, or how long from now (PT10M)."
    )
    deadline: Time = Field(
        default=None, description="When it expires, likewise; null: as its type says."
    )
    safe: Annotated[int, Field(ge=1)] | None = Field(
        default=None, description="Answer once this many journals hold it; null: a majority."
    )


class Priority(_Body):
    """A new priority."""

    priority: int


class HoldRequest(_Body):
    """Whether what runs of a held job is cancelled, too."""

    now: bool = False


class Nothing(_Body):
    """No more is needed."""


class OrderAcknowledgement(_Body):
    """The team's standing `order`, `robots` whose journals hold it, and `silent` ones."""

    order: str
    robots: list[str]
    silent: list[str]


class Acknowledgement(_Body):
    """A job after a command: `state` is open, held, or how it has ended."""

    id: str
    state: str


def client_of_page(watcher: Watcher) -> TeamClient | None:
    """The client of a team that takes jobs, None of another."""
    if not watcher.observer.mission.jobs:
        return None
    return TeamClient(watcher)


class Api:
    """What the routes answer with. `update` of the client and the feed must be called often."""

    def __init__(self, client: TeamClient, feed: Feed, access: Access) -> None:
        self._client = client
        self._watcher = client.watcher
        self._feed = feed
        self._access = access

    def application(self) -> Starlette:
        """The ASGI application, without the prefix `/v1`."""
        submit = self._guarded(self._submit, "operator")
        routes = [
            Route("/status", self._guarded(self._status)),
            Route("/job-types", self._guarded(self._job_types)),
            Route("/jobs", self._guarded(self._jobs)),
            Route("/jobs", submit, methods=["POST"]),
            Route("/jobs/{id}", self._guarded(self._job)),
            Route("/events", self._guarded(self._events)),
        ]
        for order in ORDERS:
            endpoint = self._guarded(self._order(order), "operator")
            routes.append(Route(f"/{order}", endpoint, methods=["POST"]))
        for change in CHANGES:
            endpoint = self._guarded(self._change(change), "operator")
            routes.append(Route(f"/jobs/{{id}}/{change}", endpoint, methods=["POST"]))
        return Starlette(routes=routes, exception_handlers=PROBLEMS)

    def _guarded(
        self, answer: Callable[[Request, str], Any], role: Role = "viewer"
    ) -> Callable[[Request], Any]:
        async def endpoint(request: Request) -> Response:
            caller = self._access(request, role)
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
        rows = [row for row in self._client.jobs if not states or row.state in states]
        return JSONResponse([asdict(row) for row in rows])

    async def _job(self, request: Request, _: str) -> Response:
        name, jobs = request.path_params["id"], self._watcher.observer.facts.jobs
        row = next((row for row in self._client.jobs if row.id == name), None)
        if row is not None:
            return JSONResponse(asdict(row))
        if jobs is not None and jobs.is_archived(name):
            raise HTTPException(404, f"job {name:.80} has ended long ago; only its id is known")
        raise HTTPException(404, f"no job {name!r:.80} is known here")

    async def _events(self, request: Request, _: str) -> Response:
        address = request.client.host if request.client is not None else ""
        messages = self._feed.messages(request.headers.get("last-event-id", ""), address)
        return StreamingResponse(messages, media_type="text/event-stream")

    async def _submit(self, request: Request, caller: str) -> Response:
        given = await _read(request, Submission)
        more = given.model_dump(exclude={"type", "arguments", "id"})
        arguments = self._client.arguments_of(given.type, given.arguments)
        self._require_robots()
        job = await self._client.submit(
            given.type, *arguments, job_id=given.id, operator=caller, **more
        )
        place = {"location": f"{request.url.path}/{job.id}"}
        return JSONResponse({"id": job.id, "state": job.state}, 201, headers=place)

    def _change(self, change: str) -> Callable[[Request, str], Any]:
        async def answer(request: Request, caller: str) -> Response:
            name, priority, wanted = request.path_params["id"], None, change
            if change == "priority":
                priority = (await _read(request, Priority)).priority
            elif change == "hold":
                wanted = "hold_now" if (await _read(request, HoldRequest)).now else change
            else:
                await _read(request, Nothing)
            self._require_robots()
            state = await self._client.change(name, wanted, priority, caller)
            return JSONResponse({"id": name, "state": state["state"]})

        return answer

    def _order(self, order: str) -> Callable[[Request, str], Any]:
        async def answer(request: Request, caller: str) -> Response:
            await _read(request, Nothing)
            self._require_robots()
            client = self._client
            give = {"pause": client.pause, "resume": client.resume, "abort": client.abort}[order]
            done = await give(caller)
            data = {"order": done.state["order"], "robots": done.robots, "silent": done.silent}
            return JSONResponse(data)

        return answer

    def _require_robots(self) -> None:
        if not self._client.robots:
            raise HTTPException(503, "no robot of the team is heard", RETRY)


async def limited_body(request: Request, limit_bytes: int) -> bytes:
    """The body of a request; raises HTTPException 413 if it is longer, 400 if it ends early."""
    body = b""
    try:
        async for chunk in request.stream():
            body += chunk
            if len(body) > limit_bytes:
                raise HTTPException(413, f"the body is longer than {limit_bytes} bytes")
    except ClientDisconnect:
        raise HTTPException(400, "the body is not complete") from None  # nobody reads this
    return body


async def _read(request: Request, model: type[Any]) -> Any:
    """The body; raises HTTPException 413 or 422. An empty one is an empty object."""
    try:
        return model.model_validate_json(await limited_body(request, MAX_BODY_BYTES) or b"{}")
    except ValidationError as error:
        problems = [
            f"{'.'.join(map(str, each['loc'])) or 'the body'}: {each['msg']}"
            for each in error.errors(include_url=False, include_input=False)[:10]
        ]
        raise HTTPException(422, "; ".join(problems)) from None
