"""A team's connection to an Open-RMF server: updates go out, and requests are answered.

As with RMF's own fleet adapters, the fleet is the client of a websocket, and sends JSON texts. On
the same connection requests of the task API are taken, one after the other.
"""

from __future__ import annotations

import contextlib
import json
import time
from typing import Any

import anyio
import click
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidURI

from mrbt_mesh.adapters.rmf.messages import fleet_state, task_log, task_state
from mrbt_mesh.adapters.rmf.requests import TaskApi
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.views.model.changes import ChangeLog

RETRY_S = 1.0
# Robots move all the time; tasks are sent at once.
FLEET_S, LOOK_S = 1.0, 0.1
WARNED_AT = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)


class RmfLink:
    """Keeps one server up to date, and connects again whenever the connection ends."""

    def __init__(self, client: TeamClient, changes: ChangeLog, uri: str) -> None:
        """`changes`: those of a `TeamView`, which is kept up to date elsewhere."""
        watcher = client.watcher
        self._observer, self._fleet = watcher.observer, watcher.address.transport.team
        self._api = TaskApi(client, self._fleet, _now_ms)
        self._changes = changes
        self._uri = uri
        self._version = 0
        # Job -> its row and its `task_state`, a new object after every change.
        self._rows: dict[str, dict[str, Any]] = {}
        self._states: dict[str, dict[str, Any]] = {}
        self._wrong = 0

    async def run(self) -> None:
        """Never returns. Raises InputError for a URI that cannot be right."""
        said = ""
        while self._changes.version == 0:
            await anyio.sleep(LOOK_S)
        self._look(is_older=True)
        async with anyio.create_task_group() as group:
            group.start_soon(self._follow)
            while True:
                try:
                    async with connect(self._uri, proxy=None) as connection:
                        await self._serve(connection)
                    why = "the connection has ended"
                except InvalidURI as error:
                    raise InputError(f"--rmf {self._uri}: {error}") from None
                except (OSError, InvalidHandshake) as error:
                    why = str(error)
                if why != said:
                    said = why
                    click.echo(f"rmf: {self._uri}: {why}; trying again", err=True)
                await anyio.sleep(RETRY_S)

    async def _follow(self) -> None:
        """Keep the states of tasks up to date, also without a connection."""
        while True:
            self._look()
            await anyio.sleep(LOOK_S)

    def _look(self, is_older: bool = False) -> None:
        """Take in what has changed. `is_older`: it was there before this program."""
        items = self._changes.since(self._version)
        self._version = self._changes.version
        for key, row in items.items():
            kind, _, name = key.partition("/")
            if kind != "job":
                continue
            if row is None:
                for known in (self._rows, self._states, self._api.histories):
                    known.pop(name, None)
            else:
                self._rows[name] = row
                self._api.histories[name].follow(row, _now_ms(), is_older)
                self._api.touched.add(name)
        for name in self._api.touched & self._rows.keys():
            history = self._api.histories[name]
            self._states[name] = task_state(self._rows[name], history, self._fleet)
        self._api.touched.clear()

    async def _serve(self, connection: ClientConnection) -> None:
        """Until the connection ends."""
        async with anyio.create_task_group() as group:
            group.start_soon(self._send_updates, connection)
            with contextlib.suppress(ConnectionClosed):
                async for text in connection:
                    answer, wrong = await self._api.answer(text)
                    if wrong:
                        self._count(wrong)
                    await connection.send(json.dumps(answer))
            group.cancel_scope.cancel()

    def _count(self, wrong: str) -> None:
        self._wrong += 1
        if self._wrong in WARNED_AT:
            text = f"rmf: wrong message number {self._wrong} from {self._uri}: {wrong}"
            click.echo(text.encode("ascii", "backslashreplace").decode(), err=True)

    async def _send_updates(self, connection: ClientConnection) -> None:
        """Everything, and then what changes."""
        sent: dict[str, dict[str, Any]] = {}
        logged: dict[str, int] = {}
        next_s = 0.0

        async def send(kind: str, data: dict[str, Any]) -> None:
            await connection.send(json.dumps({"type": kind, "data": data}))

        with contextlib.suppress(ConnectionClosed):
            while True:
                if anyio.current_time() >= next_s:
                    next_s = anyio.current_time() + FLEET_S
                    now = fleet_state(self._observer, self._fleet, _now_ms())
                    await send("fleet_state_update", now)
                for name, state in list(self._states.items()):
                    if sent.get(name) is state:
                        continue
                    sent[name] = state
                    await send("task_state_update", state)
                    entries = self._api.histories[name].log
                    new = [entry for entry in entries if entry["seq"] >= logged.get(name, 0)]
                    if new:
                        logged[name] = new[-1]["seq"] + 1
                        await send("task_log_update", task_log(name, new))
                for name in sent.keys() - self._states.keys():
                    sent.pop(name)
                    logged.pop(name, None)
                await anyio.sleep(LOOK_S)


def _now_ms() -> int:
    return time.time_ns() // 1_000_000
