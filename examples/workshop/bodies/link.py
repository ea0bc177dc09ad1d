"""How a robot's program reaches its body: over a Unix socket, or in virtual time in this process.

Over the socket each message is a msgpack map behind its length in 4 bytes. A robot says
`{"robot": "A1"}`, then commands; each is answered by senses, or by `{"error": ...}` and the end of
the connection. A robot that says who it is once more, on another connection, has its body there.
"""

from __future__ import annotations

import asyncio
import os
import struct
import tempfile
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import anyio
import anyio.abc
import msgpack

from bodies.messages import Command, MessageError, Senses

if TYPE_CHECKING:
    from bodies.physics import World

# A drill gives those beside the team a folder to meet in.
ADDRESS_VARIABLE, DRILL_VARIABLE = "WORKSHOP_WORLD", "MRBT_BESIDE"
MAX_BYTES = 65_536
# A world that does not answer for so long is as good as gone.
ANSWER_S = 2.0
# What a stream raises whose other end is no longer there.
GONE = (anyio.BrokenResourceError, anyio.ClosedResourceError, anyio.EndOfStream)
_LENGTH = struct.Struct(">I")


def address() -> Path:
    """The world's socket: in a drill the drill's own, else $WORKSHOP_WORLD, else the user's."""
    if DRILL_VARIABLE in os.environ:
        return Path(os.environ[DRILL_VARIABLE], "workshop.sock")
    default = f"{tempfile.gettempdir()}/workshop-{os.getuid()}.sock"
    return Path(os.environ.get(ADDRESS_VARIABLE, default))


class Link(Protocol):
    """One robot's body."""

    async def sense(self) -> Senses:
        """What is sensed before the first command. Raises OSError if the body no longer answers."""
        ...

    async def exchange(self, command: Command) -> Senses:
        """Give the motors a command and get what is sensed.

        Raises OSError if the body no longer answers.
        """
        ...

    async def close(self) -> None: ...


# -- in virtual time ---------------------------------------------------------------------------

# The world of each run; a run has an event loop of its own.
_worlds: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, World] = weakref.WeakKeyDictionary()
latest: list[World] = []
# Called whenever time has passed in such a world.
onlookers: list[Callable[[World], None]] = []


def virtual_world() -> World:
    """The world of the run in virtual time that goes on now, brought to its time."""
    from bodies.physics import World

    loop = asyncio.get_running_loop()
    if loop not in _worlds:
        latest[:] = [_worlds.setdefault(loop, World())]
    return _worlds[loop]


class VirtualLink:
    """A body in this process; the world is stepped whenever somebody asks, as far as time is."""

    def __init__(self, robot: str, unix_time_s: Any) -> None:
        self._robot = robot
        self._now_s = unix_time_s
        self._world = virtual_world()

    async def sense(self) -> Senses:
        self._pass_time()
        return self._world.senses(self._robot)

    async def exchange(self, command: Command) -> Senses:
        self._pass_time()
        return self._world.exchange(self._robot, command)

    async def close(self) -> None:
        pass

    def _pass_time(self) -> None:
        self._world.advance_to(self._now_s())
        for look_on in onlookers:
            look_on(self._world)


# -- over a socket -----------------------------------------------------------------------------


class SocketLink:
    """A body in the world's process."""

    def __init__(self, robot: str, stream: anyio.abc.SocketStream) -> None:
        self._robot = robot
        self._stream = stream

    @staticmethod
    async def connect(robot: str) -> SocketLink:
        """Raises OSError if no world is there."""
        return SocketLink(robot, await anyio.connect_unix(address()))

    async def sense(self) -> Senses:
        return await self._ask({"robot": self._robot})

    async def exchange(self, command: Command) -> Senses:
        return await self._ask(command.plain())

    async def _ask(self, message: dict[str, Any]) -> Senses:
        try:
            with anyio.fail_after(ANSWER_S):
                await send(self._stream, message)
                answer = await receive(self._stream)
        except (*GONE, MessageError) as error:
            raise ConnectionResetError("the world has ended") from error
        if "error" in answer:
            raise ConnectionRefusedError(str(answer["error"]))
        return Senses.read(answer)

    async def close(self) -> None:
        await self._stream.aclose()


async def send(stream: anyio.abc.SocketStream, message: dict[str, Any]) -> None:
    packed = msgpack.packb(message)
    await stream.send(_LENGTH.pack(len(packed)) + packed)


async def receive(stream: anyio.abc.SocketStream) -> dict[str, Any]:
    """The next message. Raises EndOfStream at the end, MessageError for what is none."""
    (length,) = _LENGTH.unpack(await _exactly(stream, _LENGTH.size))
    if length > MAX_BYTES:
        raise MessageError(f"a message has at most {MAX_BYTES} bytes, not {length}")
    packed = await _exactly(stream, length)
    try:
        message = msgpack.unpackb(packed)
    except (ValueError, msgpack.UnpackException) as error:
        raise MessageError(f"not msgpack: {error}") from None
    if not isinstance(message, dict):
        raise MessageError(f"a map is expected, not {type(message).__name__}")
    return message


async def _exactly(stream: anyio.abc.SocketStream, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += await stream.receive(size - len(data))
    return data
