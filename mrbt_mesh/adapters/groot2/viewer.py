"""Shows a team's tree live in Groot2 and other BehaviorTree.CPP monitors, over ZeroMQ."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import TYPE_CHECKING

import anyio
import anyio.lowlevel

from mrbt_mesh.errors import InputError, require
from mrbt_mesh.plugins import OpenView, ViewerOptions, check_listens

if TYPE_CHECKING:
    import zmq.asyncio

    from mrbt_mesh.adapters.groot2.monitor import MonitoredTree
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.watcher import Watcher

# Groot2's default port.
PORT = 1667
# Requests are a few bytes; names of blackboards may be longer.
MAX_REQUEST_BYTES = 1 << 16


class Groot2Viewer:
    """The team's tree T_G, or with `robot` its T_i, for monitors that connect to the address."""

    summary = "Show the team's tree, or with --robot a robot's, live in Groot2."

    def check(self, options: ViewerOptions) -> None:
        """Raise InputError if the extra is missing, or if it could not listen."""
        require_library()
        check_listens(options.host, _port(options), "Groot2's protocol")

    @asynccontextmanager
    async def showing(
        self, watcher: Watcher, team: Team | None, options: ViewerOptions
    ) -> AsyncIterator[OpenView]:
        """Answer monitors. Raises InputError if it cannot listen, or the robot is unknown."""
        from mrbt_mesh.adapters.groot2.monitor import MonitoredTree
        from mrbt_mesh.adapters.node_statuses import ObservedTree
        from mrbt_mesh.runtime.fencing import boottime_us

        tree = ObservedTree(watcher.observer.mission, options.robot)
        with listening(options.host, _port(options)) as (socket, opened):
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


def _port(options: ViewerOptions) -> int:
    return PORT if options.port is None else options.port


def require_library() -> None:
    """Raise InputError if the library is missing."""
    require("Groot2's protocol", "groot2", "zmq")


@contextmanager
def listening(host: str, port: int) -> Iterator[tuple[zmq.asyncio.Socket, int]]:
    """Open a socket for monitors; yields it and its port (`port` 0: any free port).

    Raises InputError if the library is missing, or if it cannot listen.
    """
    require_library()
    import zmq
    import zmq.asyncio

    context = zmq.asyncio.Context()
    # Not REP, which raises an error for a message without its envelope.
    socket = context.socket(zmq.ROUTER)
    try:
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.MAXMSGSIZE, MAX_REQUEST_BYTES)
        try:
            socket.bind(f"tcp://{host}:{port or '*'}")
        except zmq.ZMQError as error:
            raise InputError(f"{host}:{port}: cannot listen for Groot2: {error.strerror}") from None
        endpoint = socket.getsockopt_string(zmq.LAST_ENDPOINT)
        yield socket, int(endpoint.rpartition(":")[2])
    finally:
        socket.close()
        context.term()


async def answer_all(socket: zmq.asyncio.Socket, monitored: MonitoredTree) -> None:
    """Answer requests one after the other; never returns.

    A request follows its sender's address and an empty part; other messages are dropped.
    """
    from mrbt_mesh.runtime.fencing import boottime_us

    while True:
        message = await socket.recv_multipart()
        begin = message.index(b"", 1) + 1 if b"" in message[1:] else len(message)
        if message[begin:]:
            answer = monitored.answer(message[begin:], boottime_us())
            await socket.send_multipart([*message[:begin], *answer])
        # A burst of requests must not delay the team's messages.
        await anyio.lowlevel.checkpoint()
