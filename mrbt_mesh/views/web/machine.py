"""All runs of this machine: a page that lists them, and the page of each below `run/ID/`.

A run is watched while somebody views its page, or views the list while it runs.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import anyio.abc
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from mrbt_mesh.cli.run_list import RUNNING, listed_runs
from mrbt_mesh.cli.watching import BATCH_S, FRAME_S, past_of
from mrbt_mesh.drills.control import Control
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.headline import Level, headline, robots_that_differ
from mrbt_mesh.plugins import ViewerOptions
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.known_runs import find_run
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_address import address_of
from mrbt_mesh.runtime.watcher import watching
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.web.api import client_of_page
from mrbt_mesh.views.web.app import STATIC, Page
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.protection import OwnNames, Protection, new_token, own_names, policy
from mrbt_mesh.views.web.server import served

# How long an unviewed run is still watched, and how long a list stays fresh.
WATCHED_S, FRESH_S = 30.0, 1.0
BELOW = "/run/"
# Result of a run that is over -> level; others are bad.
LEVELS = {"success": Level.GOOD, "not_started": Level.INFO, "ended": Level.INFO}


class _Watched:
    """A run that is watched. `page` is None if it is not open yet, or cannot be (`problem`)."""

    def __init__(self) -> None:
        self.looked_s = time.monotonic()
        self.is_settled = anyio.Event()
        self.feed: Feed | None = None
        self.page: ASGIApp | None = None
        self.problem = ""


class MachineRuns:
    """Watches and serves runs. `group` has the tasks that watch them, until it is cancelled."""

    def __init__(self, has_control: bool, group: anyio.abc.TaskGroup) -> None:
        self.token = new_token() if has_control else ""
        self._own = own_names((), 0)
        self._group = group
        self._watched: dict[str, _Watched] = {}
        self._rows: list[dict[str, Any]] = []
        self._listed_s = float("-inf")

    def application(self, own: OwnNames) -> ASGIApp:
        """Return the ASGI application, for the names by which it is reached."""
        self._own = own
        html = (STATIC / "runs.html").read_bytes()
        index = HTMLResponse(html)
        routes = [
            Route("/", index),
            Route("/runs", self._list),
            Route("/metrics", self._metrics),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        protection = Middleware(Protection, own=own, content_policy=policy(html))
        lists = Starlette(routes=routes, middleware=[protection])

        async def application(scope: Scope, receive: Receive, send: Send) -> None:
            host = dict(scope.get("headers", ())).get(b"host", b"").decode("latin-1").lower()
            is_below = scope.get("path", "").startswith(BELOW) and host in own.hosts
            await (self._below if is_below else lists)(scope, receive, send)

        return application

    def close(self) -> None:
        """End the streams of all pages."""
        for watched in self._watched.values():
            if watched.feed is not None:
                watched.feed.close()

    async def _below(self, scope: Scope, receive: Receive, send: Send) -> None:
        run, slash, rest = scope["path"].removeprefix(BELOW).partition("/")
        watched = await self._page_of(run)
        answer: ASGIApp
        if watched is None:
            answer = PlainTextResponse("no run of this machine has this name", status_code=404)
        elif watched.page is None:
            answer = PlainTextResponse(watched.problem, status_code=409)
        elif not slash:
            answer = PlainTextResponse("", status_code=308, headers={"location": f"{run}/"})
        else:
            answer = watched.page
        await answer({**scope, "path": f"/{rest}"}, receive, send)

    # -- the list ---------------------------------------------------------------------------

    async def _list(self, request: Request) -> Response:
        rows = await self._listed()
        if "headlines" in request.query_params:
            rows = [self._said(row) for row in rows]
        return JSONResponse({"runs": rows})

    async def _listed(self) -> list[dict[str, Any]]:
        """Return the same rows as `mrbt ls`."""
        if time.monotonic() > self._listed_s + FRESH_S:
            self._listed_s = time.monotonic()
            self._rows = await anyio.to_thread.run_sync(listed_runs)
        return self._rows

    def _said(self, row: dict[str, Any]) -> dict[str, Any]:
        """Return the row with the worst statement of the team's headline, or its result.

        Teams that run are watched from now on.
        """
        if row["result"] != RUNNING:
            level, text = LEVELS.get(row["result"], Level.BAD), row["result"].replace("_", " ")
            said: dict[str, Any] = {"level": str(level), "text": text}
            return row | {"headline": said, "dead": None}
        watched = self._watch(row)
        if watched.feed is None:
            text = watched.problem or RUNNING
            return row | {"headline": {"level": "info", "text": text}, "dead": None}
        observer = watched.feed.observer
        worst = headline(observer, robots_that_differ(observer), boottime_us())[0].to_json()
        states = Counter(str(observer.robot_state(robot)) for robot in observer.robots())
        return row | {"headline": worst, "dead": states["dead"]}

    async def _metrics(self, request: Request) -> Response:
        """Redirect to the metrics of the one team that a command without a name would mean."""
        try:
            run = find_run(None).info().run
        except InputError as error:
            return PlainTextResponse(str(error), status_code=409)
        return Response(status_code=307, headers={"location": f"run/{run}/metrics"})

    # -- one run ----------------------------------------------------------------------------

    async def _page_of(self, run: str) -> _Watched | None:
        """Return the run, once it is known whether it can be watched.

        None: there is no such run.
        """
        watched = self._watched.get(run)
        if watched is None:
            row = next((row for row in await self._listed() if row["run"] == run), None)
            if row is None:
                return None
            watched = self._watch(row)
        watched.looked_s = time.monotonic()
        await watched.is_settled.wait()
        return watched

    def _watch(self, row: dict[str, Any]) -> _Watched:
        watched = self._watched.get(row["run"])
        if watched is None:
            watched = self._watched[row["run"]] = _Watched()
            self._group.start_soon(self._follow, row["run"], Path(row["run_dir"]), watched)
        watched.looked_s = time.monotonic()
        return watched

    async def _follow(self, run: str, path: Path, watched: _Watched) -> None:
        try:
            await self._show(RunDir(path), watched)
        except InputError as error:
            watched.problem = f"the run cannot be watched: {error}"
            watched.page = watched.feed = None
            watched.is_settled.set()
            await anyio.sleep(WATCHED_S)
        finally:
            del self._watched[run]

    async def _show(self, run_dir: RunDir, watched: _Watched) -> None:
        address = address_of(run_dir)
        team = Team(run_dir, run_dir.info(), address.mission)
        async with (
            watching(address, tell_past=past_of(team), batch_s=BATCH_S) as watcher,
            anyio.create_task_group() as group,
        ):
            if not team.living():
                team.result(watcher.observer, boottime_us())
                team.note_unseen_deaths(watcher.observer, boottime_us())
            group.start_soon(team.note_exits, watcher)
            feed = watched.feed = Feed(TeamView(watcher.observer), boottime_us)
            control = Control(watcher, team, group) if self.token else None
            client = client_of_page(watcher)
            page = Page(
                feed,
                replace(self._own, prefix=f"{self._own.prefix}{BELOW}{run_dir.info().run}"),
                control,
                self.token,
                run_dir=run_dir.path,
                above="../../",
                client=client,
            )
            watched.page = page.application()
            try:
                while feed.pages or time.monotonic() < watched.looked_s + WATCHED_S:
                    await watcher.wait_for_change(FRAME_S)
                    feed.update()
                    watched.is_settled.set()
            finally:
                feed.close()
            group.cancel_scope.cancel()


@asynccontextmanager
async def showing_machine(options: ViewerOptions) -> AsyncIterator[str]:
    """Serve the runs of this machine, and yield the address to open.

    It is the page of the one team that runs, else the list. Raises PageError.
    """
    async with anyio.create_task_group() as group:
        machine = MachineRuns(options.has_control, group)
        async with served(options, machine.close, machine.application) as address:
            fragment = f"#{machine.token}" if machine.token else ""
            yield f"{address}{_only_run()}{fragment}"
            group.cancel_scope.cancel()


def _only_run() -> str:
    """Return the path of the team that a command without a name would mean; empty if ambiguous."""
    try:
        return f"{BELOW[1:]}{find_run(None).info().run}/"
    except InputError:
        return ""
