"""Serves a tree to Groot2 over ZeroMQ, beside the event loop that watches the team."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import anyio.lowlevel

from mrbt_mesh.adapters.groot2.monitored import MonitoredTree
from mrbt_mesh.errors import InputError
from mrbt_mesh.plugins import require
from mrbt_mesh.runtime.fencing import boottime_us

if TYPE_CHECKING:
    import zmq.asyncio

# Requests are a few bytes; names of blackboards may be longer.
MAX_REQUEST_BYTES = 1 << 16


@contextmanager
def listening(host: str, port: int) -> Iterator[tuple[zmq.asyncio.Socket, int]]:
    """A socket for monitors, and its port (`port` 0: any that is free).

    Raises InputError without the library, and where it cannot listen.
    """
    require("Groot2's protocol", "groot2", "zmq")
    import zmq
    import zmq.asyncio

    context = zmq.asyncio.Context()
    # Not REP, for which a message without its envelope ends in an error of the one who answers.
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
    """Answer one request after the other; never returns.

    A request follows the address of its sender and an empty part; all else is dropped.
    """
    while True:
        message = await socket.recv_multipart()
        begin = message.index(b"", 1) + 1 if b"" in message[1:] else len(message)
        if message[begin:]:
            answer = monitored.answer(message[begin:], boottime_us())
            await socket.send_multipart([*message[:begin], *answer])
        # Many requests at once must not keep the team's messages waiting.
        await anyio.lowlevel.checkpoint()
