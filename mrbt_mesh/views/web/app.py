"""The page's routes: its files, a stream of events, explanations, metrics, and commands."""

from __future__ import annotations

import json
import mimetypes
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from shlex import quote
from typing import Any, Protocol, TypeAlias

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from mrbt_mesh import plugins
from mrbt_mesh.drills.control import CommandError, Control
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.folder import first_part, observer_files, robot_files
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.views.model.mission_view import mission_view
from mrbt_mesh.views.model.next_steps import (
    NextStep,
    next_of_job,
    next_of_robot,
    next_of_task,
    steps_to_json,
)
from mrbt_mesh.views.model.own_trees import own_trees
from mrbt_mesh.views.model.why import why_job, why_robot, why_task
from mrbt_mesh.views.web.access import page_access
from mrbt_mesh.views.web.api import Api, events
from mrbt_mesh.views.web.bodies import json_body
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.protection import OwnNames, Protection, policy, why_no_command

STATIC = Path(__file__).with_name("static")
MAX_COMMAND_BYTES = 4_096
Endpoint: TypeAlias = Callable[[Request], Awaitable[Response]]
Explanation: TypeAlias = Callable[[Observer, str], Mapping[str, Any]]
Foresight: TypeAlias = Callable[[Observer, str, int], list[NextStep]]

# Not every system knows this type, and browsers run no module of another type.
mimetypes.add_type("text/javascript", ".mjs")


class Projector(Protocol):
    """Shows a recording under the control of its viewers."""

    def to_json(self) -> Mapping[str, Any]:
        """Return the constant properties of the recording."""

    def carry_out(self, wish: Any) -> None:
        """Pause, play, go to a time, or change the speed. Raises ValueError for anything else."""


class Page:
    """The answers of the routes.

    `control` is None if nothing may be controlled, `projector` if a running team is shown,
    `run_dir` if that is not on this machine. `above`: the path from here to the list of the
    machine's runs, if there is one. `client`: the client of a team that takes jobs, whose API is
    below `/v1`.
    """

    def __init__(
        self,
        feed: Feed,
        own: OwnNames,
        control: Control | None = None,
        token: str = "",
        projector: Projector | None = None,
        run_dir: Path | None = None,
        above: str | None = None,
        client: TeamClient | None = None,
    ) -> None:
        self._feed = feed
        self._own = own
        self._control = control
        self._access = page_access(own, token if control is not None else None)
        self._client = client
        self._projector = projector
        self._run_dir = run_dir
        self._above = above
        self._html = (STATIC / "index.html").read_bytes()

    def application(self) -> Starlette:
        """Return the ASGI application."""
        routes = [
            Route("/", self._index),
            Route("/mission", self._mission),
            Route("/events", self._events),
            Route("/why/robot/{name}", self._about(self._why(why_robot, next_of_robot))),
            Route("/why/task/{name:path}", self._about(self._why(why_task, next_of_task))),
            Route("/why/job/{name}", self._about(self._why(why_job, next_of_job))),
            Route("/trees/{name}", self._about(own_trees)),
            Route("/drills", self._drills),
            Route("/commands", self._command, methods=["POST"]),
            Route("/metrics", self._metrics),
            Route("/playback", self._playback, methods=["POST"]),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        if self._client is not None:
            api = Api(self._client, self._feed, self._access, self._own.prefix)
            routes.append(Mount("/v1", api.application()))
        protection = Middleware(Protection, own=self._own, content_policy=policy(self._html))
        return Starlette(routes=routes, middleware=[protection])

    async def _index(self, request: Request) -> Response:
        return HTMLResponse(self._html)

    async def _mission(self, request: Request) -> Response:
        control = self._control.offers() if self._control is not None else None
        mission = mission_view(self._feed.observer.mission)
        recording = self._projector.to_json() if self._projector is not None else None
        more = {"control": control, "recording": recording, "commands": self._commands()}
        about = {"run": self._feed.observer.facts.run, "above": self._above}
        return JSONResponse(mission | more | about)

    def _commands(self) -> dict[str, str]:
        """Return what can be done with the run when it is over -> the command for it."""
        if self._run_dir is None:
            return {}
        found = {"make a report": f"mrbt recording report {quote(str(self._run_dir))}"}
        files = [*observer_files(self._run_dir), *robot_files(self._run_dir)]
        recordings = [first_part(path) for path in files]
        if recordings:
            replay = f"mrbt recording replay {quote(str(recordings[0]))} --web"
            found = {"see it again": replay} | found
        return found

    async def _events(self, request: Request) -> Response:
        return events(request, self._feed)

    def _about(self, explain: Explanation) -> Endpoint:
        """Return an endpoint that answers for the name in the path."""

        async def answer(request: Request) -> Response:
            name = request.path_params["name"]
            try:
                return JSONResponse(explain(self._feed.observer, name))
            except KeyError:
                raise HTTPException(404, f"nothing is known of {name[:80]}") from None

        return answer

    def _why(self, explain: Explanation, foresee: Foresight) -> Explanation:
        """Return an explanation with what happens `next`."""

        def answer(observer: Observer, name: str) -> dict[str, Any]:
            found = foresee(observer, name, self._feed.now_us)
            return {**explain(observer, name), "next": steps_to_json(found)}

        return answer

    async def _metrics(self, request: Request) -> Response:
        """Return the team's metrics for Prometheus; a recording has none."""
        if self._projector is not None:
            raise HTTPException(404, "a recording has no metrics")
        try:
            accept = request.headers.get("accept", "")
            text, content_type = plugins.metrics().team_page(self._feed.observer, accept)
        except InputError as error:
            raise HTTPException(501, str(error)) from error
        return Response(text, headers={"content-type": content_type})

    # -- commands ---------------------------------------------------------------------------

    def _controlled(self, request: Request) -> Control:
        """Return the control, if the request may give commands."""
        self._access(request, "operator")
        assert self._control is not None
        return self._control

    async def _drills(self, request: Request) -> Response:
        try:
            return JSONResponse(await self._controlled(request).drills())
        except CommandError as error:
            raise HTTPException(409, str(error)) from error

    async def _command(self, request: Request) -> Response:
        control = self._controlled(request)
        body = await json_body(request, MAX_COMMAND_BYTES)
        try:
            text = await control.carry_out(json.loads(body))
        except (CommandError, ValueError, RecursionError) as error:
            return JSONResponse({"done": False, "text": str(error)}, status_code=400)
        return JSONResponse({"done": True, "text": text})

    async def _playback(self, request: Request) -> Response:
        """Control the playback of a recording; any page of this server may do so."""
        if self._projector is None:
            raise HTTPException(404, "this page shows a team that runs, no recording")
        refusal = why_no_command(request.headers, self._own)
        if refusal is not None:
            raise HTTPException(403, refusal)
        body = await json_body(request, MAX_COMMAND_BYTES)
        try:
            self._projector.carry_out(json.loads(body))
        except (ValueError, RecursionError) as error:
            raise HTTPException(400, str(error)) from error
        return Response(status_code=204)
