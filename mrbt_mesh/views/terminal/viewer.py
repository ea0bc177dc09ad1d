"""The plug-in that shows a team in the terminal, with keys."""

from __future__ import annotations

import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import anyio

from mrbt_mesh.errors import InputError, require
from mrbt_mesh.plugins import OpenView, ViewerOptions

if TYPE_CHECKING:
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.watcher import Watcher


class TopViewer:
    """Panes with keys; with `has_control` some keys act on the team, after a question."""

    summary = "Show the team in this terminal, by keys: tree, robots, timeline, and why; q ends it."

    def check(self, options: ViewerOptions) -> None:
        """Raise InputError without a terminal, or without textual."""
        require("the view by keys", "terminal", "textual")
        # textual draws on standard error.
        if not all(stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr)):
            raise InputError("the view by keys needs a terminal; --headless prints lines")

    @asynccontextmanager
    async def showing(
        self, watcher: Watcher, team: Team | None, options: ViewerOptions
    ) -> AsyncIterator[OpenView]:
        """Show the team until the user quits."""
        from mrbt_mesh.drills.control import Control
        from mrbt_mesh.runtime.fencing import boottime_us
        from mrbt_mesh.views.model.team_view import TeamView
        from mrbt_mesh.views.terminal.app import TeamTop

        closed = anyio.Event()
        async with anyio.create_task_group() as group:
            control = Control(watcher, team, group) if options.has_control else None
            app = TeamTop(TeamView(watcher.observer), boottime_us, control, options.notes)

            async def run() -> None:
                await app.run_async()
                closed.set()
                watcher.changed.set()

            group.start_soon(run)
            yield OpenView("", lambda: None, closed)
            if not closed.is_set():
                app.exit()
                await closed.wait()
            group.cancel_scope.cancel()


viewer = TopViewer()
