"""The plug-in that shows a team's tree in Groot2 and in other monitors of BehaviorTree.CPP."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import anyio

from mrbt_mesh.plugins import OpenView, ViewerOptions, require

if TYPE_CHECKING:
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.watcher import Watcher

# Groot2's own.
PORT = 1667


class Groot2Viewer:
    """The team's tree T_G, or with `robot` its T_i, for monitors that connect to the address."""

    summary = "Show the team's tree, or with --robot a robot's, live in Groot2."

    def check(self, options: ViewerOptions) -> None:
        """Raises InputError without the extra."""
        require("Groot2's protocol", "groot2", "zmq")

    @asynccontextmanager
    async def showing(
        self, watcher: Watcher, team: Team | None, options: ViewerOptions
    ) -> AsyncIterator[OpenView]:
        """Answer monitors. Raises InputError if it cannot listen, or the robot is not known."""
        from mrbt_mesh.adapters.groot2.monitored import MonitoredTree
        from mrbt_mesh.adapters.groot2.serve import answer_all, listening
        from mrbt_mesh.adapters.node_statuses import observed_tree
        from mrbt_mesh.runtime.fencing import boottime_us

        tree = observed_tree(watcher.observer.mission, options.robot)
        port = PORT if options.port is None else options.port
        with listening(options.host, port) as (socket, opened):
            monitored = MonitoredTree(tree, watcher.observer)
            async with anyio.create_task_group() as group:
                group.start_soon(answer_all, socket, monitored)
                yield OpenView(
                    f"{options.host}:{opened}",
                    lambda: monitored.update(boottime_us()),
                    anyio.Event(),
                )
                group.cancel_scope.cancel()


viewer = Groot2Viewer()
