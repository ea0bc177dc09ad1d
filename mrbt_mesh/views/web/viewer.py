"""The plug-in that shows a team on a page in the browser."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import anyio

from mrbt_mesh.plugins import OpenView, ViewerOptions, require

if TYPE_CHECKING:
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.watcher import Watcher


class WebViewer:
    """A page on `port`, by default a free one; with `has_control` it has buttons."""

    summary = "Show the team in the browser: its tree, robots, timeline, and why."

    def check(self, options: ViewerOptions) -> None:
        """Raises InputError without the extra, and for an address that cannot be used."""
        require("the page", "web", "starlette", "uvicorn")
        from mrbt_mesh.views.web.server import PageOptions, bound

        bound(PageOptions(options.host, options.port or 0)).close()

    @asynccontextmanager
    async def showing(
        self, watcher: Watcher, team: Team | None, options: ViewerOptions
    ) -> AsyncIterator[OpenView]:
        """Serve the page; its address has the token for orders."""
        from mrbt_mesh.views.web.server import PageOptions, serving

        page = PageOptions(options.host, options.port or 0, options.has_control)
        async with serving(watcher, team, page) as (address, feed):
            yield OpenView(address, feed.update, anyio.Event())


viewer = WebViewer()
