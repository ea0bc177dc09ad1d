"""Monitors of BehaviorTree.CPP: a team whose tree is served, and a client for it.

The client is written from the protocol's description, and knows nothing of the server's code.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager

import anyio
import zmq

from mrbt_mesh.adapters.groot2.monitor import MonitoredTree
from mrbt_mesh.adapters.groot2.viewer import answer_all, listening
from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.observer.observer import Observer
from tests.support.script import Script

TIMEOUT_MS = 10_000
TEAM = """
robot A weld lift
robot B weld*0.5 lift
task cover lift 2..2
tree Sequence(Fallback("?done", "weld"), "cover")
observe
start A B
"""


def header(kind: str, number: int = 7) -> bytes:
    return struct.pack("<BBI", 2, ord(kind), number)


class Desk:
    """A team in memory and the tree that is served."""

    def __init__(self, robot: str | None = None) -> None:
        self.script = Script()
        self.script.block(TEAM.strip().splitlines())
        observer = self.script.team.observer
        assert observer is not None
        self.observer: Observer = observer
        self.monitored = MonitoredTree(ObservedTree(observer.mission, robot), observer)

    def go(self, *commands: str) -> None:
        self.script.block(list(commands))
        self.monitored.update(self.script.team.now_us)

    def ask(self, kind: str, *more: bytes) -> list[bytes]:
        """What follows the header."""
        parts = self.monitored.answer([header(kind), *more], self.script.team.now_us)
        assert parts[0][:6] == header(kind), parts
        assert len(parts[0]) == 22
        return parts[1:]

    def error(self, kind: str, *more: bytes) -> str:
        first, text = self.monitored.answer([header(kind), *more], 0)
        assert first == b"error"
        return text.decode()

    def statuses(self) -> list[int]:
        (data,) = self.ask("S")
        assert [uid for uid, _ in struct.iter_unpack("<HB", data)] == [1, 2, 3, 4, 5]
        return [status for _, status in struct.iter_unpack("<HB", data)]


@contextmanager
def served(monitored: MonitoredTree) -> Iterator[int]:
    """Serve a tree from a thread; yields the port."""
    ports: list[int] = []
    scopes: list[anyio.CancelScope] = []
    ready = threading.Event()

    async def main() -> None:
        with listening("127.0.0.1", 0) as (socket, port), anyio.CancelScope() as scope:
            ports.append(port)
            scopes.append(scope)
            tokens.append(anyio.lowlevel.current_token())
            ready.set()
            await answer_all(socket, monitored)

    tokens: list[anyio.lowlevel.EventLoopToken] = []
    thread = threading.Thread(target=anyio.run, args=(main,))
    thread.start()
    assert ready.wait(10)
    try:
        yield ports[0]
    finally:
        anyio.from_thread.run_sync(scopes[0].cancel, token=tokens[0])
        thread.join()


class Monitor:
    """Speaks to a publisher as Groot2 does."""

    def __init__(self, port: int) -> None:
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVTIMEO, TIMEOUT_MS)
        self._socket.connect(f"tcp://127.0.0.1:{port}")

    def close(self) -> None:
        self._socket.close()
        self._context.term()

    def raw(self, *parts: bytes) -> list[bytes]:
        """One message and its answer, as they are."""
        self._socket.send_multipart(parts)
        return list(self._socket.recv_multipart())

    def ask(self, kind: str, *more: bytes, number: int = 0xDEADBEEF) -> list[bytes]:
        """A request; returns what follows the header of the answer, which must fit."""
        request = bytes([2, ord(kind)]) + struct.pack("<I", number)
        answer = self.raw(request, *more)
        assert answer[0] != b"error", answer[1]
        assert len(answer[0]) == 22
        assert answer[0][:6] == request
        return answer[1:]

    def statuses(self) -> dict[int, int]:
        """uid -> status byte."""
        (data,) = self.ask("S")
        assert len(data) % 3 == 0
        return dict(struct.iter_unpack("<HB", data))


def monitoring(port: int) -> closing[Monitor]:
    """A client of a publisher."""
    return closing(Monitor(port))
