"""A viewer by Foxglove's websocket protocol, written from its description alone.

https://github.com/foxglove/ws-protocol: JSON for what is offered and asked for, bytes for messages.
"""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

SUBPROTOCOL = "foxglove.sdk.v1"
MESSAGE_DATA = 1
TIMEOUT_S = 10.0


@dataclass(frozen=True)
class Received:
    """One message: the topic, the time in nanoseconds, its text and what that says."""

    topic: str
    at_ns: int
    text: bytes
    data: dict[str, Any] = field(hash=False)


class Viewer:
    """Asks for channels, and takes what comes."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self.server: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: dict[int, str] = {}

    async def _next(self) -> Any:
        return await asyncio.wait_for(self._socket.recv(), TIMEOUT_S)

    async def offered(self, wanted: Iterable[str]) -> None:
        """Wait until these topics are offered."""
        while not self.server or not set(wanted) <= self.channels.keys():
            said = json.loads(await self._next())
            if said["op"] == "serverInfo":
                self.server = said
            elif said["op"] == "advertise":
                self.channels.update({each["topic"]: each for each in said["channels"]})

    async def ask(self, *topics: str) -> None:
        """Subscribe."""
        wanted = []
        for topic in topics:
            number = len(self._topics) + 100
            self._topics[number] = topic
            wanted.append({"id": number, "channelId": self.channels[topic]["id"]})
        await self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    async def message(self) -> Received:
        """The next message."""
        while isinstance(frame := await self._next(), str):
            pass
        kind, number, at_ns = struct.unpack_from("<BIQ", frame)
        assert kind == MESSAGE_DATA
        text = frame[struct.calcsize("<BIQ") :]
        return Received(self._topics[number], at_ns, text, json.loads(text))

    async def messages(self, count: int) -> list[Received]:
        """The next `count` messages."""
        return [await self.message() for _ in range(count)]


@asynccontextmanager
async def viewer(address: str) -> AsyncIterator[Viewer]:
    """One that is connected."""
    from websockets.asyncio.client import connect
    from websockets.typing import Subprotocol

    async with connect(address, subprotocols=[Subprotocol(SUBPROTOCOL)], max_size=None) as socket:
        assert socket.subprotocol == SUBPROTOCOL
        yield Viewer(socket)
