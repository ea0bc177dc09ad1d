"""The connection to a server that redirects, sends too much, or knows tasks of another run."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from http import HTTPStatus
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import anyio
import pytest
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from mrbt_mesh.adapters.rmf import connection, link
from mrbt_mesh.adapters.rmf.link import RmfLink
from mrbt_mesh.adapters.rmf.told_tasks import ToldTasks
from tests.support.one_robot import DeskClient

WAIT_S = 60.0
DISCOVER = json.dumps({"type": "task_discovery_request"})


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    monkeypatch.setattr(link, "fleet_state", lambda _, fleet, __: {"name": fleet})
    monkeypatch.setattr(link, "RETRY_S", 0.01)


class Server:
    """What is done on each connection ends the test once it returns true."""

    def __init__(self, take: Callable[[ServerConnection, int], Awaitable[bool]]) -> None:
        self._take = take
        self._count = 0
        self.done = anyio.Event()
        self.redirect = ""

    async def __call__(self, websocket: ServerConnection) -> None:
        self._count += 1
        if await self._take(websocket, self._count):
            self.done.set()

    def answer(self, _: ServerConnection, __: Request) -> Response | None:
        if not self.redirect:
            return None
        headers, self.redirect = Headers({"Location": self.redirect}), ""
        return Response(HTTPStatus.MOVED_PERMANENTLY, "Moved", headers)


@asynccontextmanager
async def linked(server: Server, *told: dict[str, Any]) -> AsyncIterator[None]:
    """Until the server is done. `told`: the states that the link of an earlier run has sent it."""
    client = DeskClient()
    client.watcher.observer.caught_up = True  # type: ignore[misc]
    changes = SimpleNamespace(version=1, since=lambda _: {})
    async with serve(server, "127.0.0.1", 0, process_request=server.answer) as listening:
        uri = f"ws://127.0.0.1:{listening.sockets[0].getsockname()[1]}/"
        for state in told:
            ToldTasks(json.dumps([uri, "depot"]), pytest.fail).will_send(state)
        made = RmfLink(client, changes, uri, "depot")  # type: ignore[arg-type]
        async with anyio.create_task_group() as group:
            group.start_soon(made.run)
            with anyio.fail_after(WAIT_S):
                yield
                await server.done.wait()
            group.cancel_scope.cancel()


async def answered(websocket: ServerConnection) -> dict[str, Any]:
    """The next message that is no update."""
    while True:
        message: dict[str, Any] = json.loads(await websocket.recv())
        kind = message.get("type", "")
        if not kind.endswith("_update") or kind == "task_discovery_update":
            return message


async def test_a_redirect_to_what_is_no_websocket_is_tried_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def take(websocket: ServerConnection, count: int) -> bool:
        await websocket.recv()
        server.redirect = "https://rmf.example/_internal"
        return count == 2

    server = Server(take)
    server.redirect = "http://rmf.example/"
    async with linked(server):
        pass
    said = capsys.readouterr().err
    assert "the server redirects to 'http://rmf.example/' (HTTP 301)" in said
    assert "the server redirects to 'https://rmf.example/_internal' (HTTP 301)" in said
    assert "Traceback" not in said


async def test_a_long_request_is_refused_and_those_behind_it_are_answered(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def take(websocket: ServerConnection, _: int) -> bool:
        await websocket.send(" " * connection.MAX_REQUEST_BYTES + "{}")
        await websocket.send(DISCOVER)
        refused = await answered(websocket)
        assert (refused["success"], refused["errors"][0]["code"]) == (False, 413)
        assert (await answered(websocket))["type"] == "task_discovery_update"
        return True

    async with linked(Server(take)):
        pass
    assert "wrong message number 1" in capsys.readouterr().err


async def test_what_is_too_long_to_be_read_ends_the_connection_and_that_is_said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection, "MAX_MESSAGE_BYTES", 5_000)
    monkeypatch.setattr(link, "MAX_MESSAGE_BYTES", 5_000)

    async def take(websocket: ServerConnection, count: int) -> bool:
        if count == 1:
            await websocket.send(" " * 6_000)
            await websocket.wait_closed()
        return count == 2

    async with linked(Server(take)):
        pass
    said = capsys.readouterr().err
    assert "a message of more than 5000 bytes, which ends the connection; trying again" in said


async def test_a_task_of_another_run_that_nobody_knows_ends_as_an_error() -> None:
    async def take(websocket: ServerConnection, _: int) -> bool:
        while True:
            message = json.loads(await websocket.recv())
            if message["type"] == "task_state_update":
                data = message["data"]
                assert (data["booking"]["id"], data["status"]) == ("old", "error")
                return True

    async with linked(Server(take), {"booking": {"id": "old"}, "status": "queued"}):
        pass
