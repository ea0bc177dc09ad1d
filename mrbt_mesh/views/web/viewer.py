"""The plug-in that shows a team on a page in the browser."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import anyio

from mrbt_mesh.errors import require
from mrbt_mesh.plugins import OpenView, ViewerOptions

if TYPE_CHECKING:
    from starlette.types import ASGIApp

    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.watcher import Watcher
    from mrbt_mesh.views.web.protection import OwnNames


class WebViewer:
    """A page on `port`, by default a free one; with `has_control` it has buttons."""

    summary = "Show the team in the browser: its tree, robots, timeline, and why."

    def check(self, options: ViewerOptions) -> None:
        """Raise InputError without the extra, and for an address that cannot be used."""
        require("the page", "web", "starlette", "uvicorn")
        from mrbt_mesh.views.web.server import bound

        bound(options).close()

    @asynccontextmanager
    async def showing(
        self, watcher: Watcher, team: Team | None, options: ViewerOptions
    ) -> AsyncIterator[OpenView]:
        """Serve the page; with control, its address contains the token for commands."""
        from mrbt_mesh.drills.control import Control
        from mrbt_mesh.runtime.fencing import boottime_us
        from mrbt_mesh.views.model.team_view import TeamView
        from mrbt_mesh.views.web.api import client_of_page
        from mrbt_mesh.views.web.app import Page
        from mrbt_mesh.views.web.feed import Feed
        from mrbt_mesh.views.web.protection import new_token
        from mrbt_mesh.views.web.server import served

        feed, token = Feed(TeamView(watcher.observer), boottime_us), new_token()
        async with anyio.create_task_group() as group:
            control = Control(watcher, team, group) if options.has_control else None
            run_dir = team.run_dir.path if team is not None else None

            client = client_of_page(watcher)

            def page_for(own: OwnNames) -> ASGIApp:
                page = Page(feed, own, control, token, run_dir=run_dir, client=client)
                return page.application()

            async with served(options, feed.close, page_for) as page:
                address = f"{page}#{token}" if control is not None else page
                yield OpenView(address, feed.update, anyio.Event(), stays=True)
            group.cancel_scope.cancel()

    @asynccontextmanager
    async def showing_machine(self, options: ViewerOptions) -> AsyncIterator[str]:
        """Serve the list of this machine's runs, and the page of each."""
        from mrbt_mesh.views.web.machine import showing_machine

        async with showing_machine(options) as address:
            yield address


viewer = WebViewer()
