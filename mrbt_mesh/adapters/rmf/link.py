"""A team's connection to an Open-RMF server: sends updates and answers requests.

Like RMF's own fleet adapters, the fleet is the client of a websocket and sends JSON texts. Requests
of the task API arrive on the same connection and are answered in order.
"""

from __future__ import annotations

import contextlib
import json
import time
from typing import Any

import anyio
import click
from anyio.abc import TaskGroup
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.frames import CloseCode

from mrbt_mesh.adapters.rmf.connection import MAX_MESSAGE_BYTES, RmfConnection
from mrbt_mesh.adapters.rmf.in_order import RequestsInOrder
from mrbt_mesh.adapters.rmf.messages import fleet_state, last_state, task_log, task_state
from mrbt_mesh.adapters.rmf.own_errors import WARNED_AT, OwnErrors
from mrbt_mesh.adapters.rmf.requests import TaskApi
from mrbt_mesh.adapters.rmf.told_tasks import ToldTasks
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.views.model.changes import ChangeLog

RETRY_S = 1.0
# Period of fleet states (robots move all the time); tasks are checked for changes more often.
FLEET_S, LOOK_S = 1.0, 0.1


class RmfLink:
    """Keeps one server up to date, and connects again whenever the connection ends."""

    def __init__(self, client: TeamClient, changes: ChangeLog, uri: str, fleet: str = "") -> None:
        """Make a link to the server `uri`.

        `changes`: those of a `TeamView`, which is kept up to date elsewhere. `fleet`: the name of
        the fleet; empty: the mission's name, which is the same in each run.
        """
        watcher = client.watcher
        self._client, self._observer = client, watcher.observer
        self._fleet = fleet or watcher.observer.mission.name
        self._told = ToldTasks(json.dumps([uri, self._fleet]), _say)
        self._own_errors = OwnErrors("rmf")
        self._api = TaskApi(client, self._fleet, _now_ms, self._own_errors)
        self._changes = changes
        self._uri = uri
        self._version = 0
        # Job -> its row and its `task_state`, a new object after every change.
        self._rows: dict[str, dict[str, Any]] = {}
        self._states: dict[str, dict[str, Any]] = {}
        self._wrong = 0

    async def run(self) -> None:
        """Keep the connection; never returns.

        An error of the server or of this program ends a connection, but not the process.
        """
        said = ""
        while self._changes.version == 0:
            await anyio.sleep(LOOK_S)
        async with anyio.create_task_group() as group:
            group.start_soon(self._follow)
            while True:
                why = await self._connect(group)
                if why != said:
                    said = why
                    _say(f"{self._uri}: {why}; trying again")
                await anyio.sleep(RETRY_S)

    async def _connect(self, group: TaskGroup) -> str:
        """Open one connection and serve it. Returns why it ended, or why it was not opened."""
        try:
            async with RmfConnection(self._uri) as connection:
                return await self._serve(connection, group)
        except (OSError, InvalidHandshake) as error:
            return str(error)
        except Exception as error:
            self._own_errors.report(error)
            return f"an error of mrbt serve: {type(error).__name__}"

    async def _follow(self) -> None:
        """Keep the states of tasks up to date, even without a connection."""
        while True:
            try:
                self._look()
            except Exception as error:
                self._own_errors.report(error)
            await anyio.sleep(LOOK_S)

    def _look(self) -> None:
        """Process the changes since the last call."""
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
                self._api.histories[name].follow(row, _now_ms())
                self._api.touched.add(name)
        for name in self._api.touched & self._rows.keys():
            history = self._api.histories[name]
            self._states[name] = task_state(self._rows[name], history, self._fleet)
        self._api.touched.clear()

    async def _serve(self, connection: ClientConnection, group: TaskGroup) -> str:
        """Serve a connection. Returns why it ended. Requests are carried out in `group`."""
        requests = RequestsInOrder(group, self._api.answer)
        why = "the connection has ended"
        async with anyio.create_task_group() as sending:
            sending.start_soon(self._send_updates, connection)
            sending.start_soon(self._send_answers, connection, requests)
            try:
                async for text in connection:
                    await requests.take(text)
            except ConnectionClosed as closed:
                if closed.sent is not None and closed.sent.code == CloseCode.MESSAGE_TOO_BIG:
                    size = f"more than {MAX_MESSAGE_BYTES} bytes"
                    why = f"the server sent a message of {size}, which ends the connection"
            sending.cancel_scope.cancel()
        return why

    async def _send_answers(
        self,
        connection: ClientConnection,
        requests: RequestsInOrder[str | bytes, tuple[dict[str, Any], str]],
    ) -> None:
        with contextlib.suppress(ConnectionClosed):
            async for answer, wrong in requests.answers():
                if wrong:
                    self._count(wrong)
                await connection.send(json.dumps(answer))

    def _count(self, wrong: str) -> None:
        self._wrong += 1
        if self._wrong in WARNED_AT:
            _say(f"wrong message number {self._wrong} from {self._uri}: {wrong}")

    async def _send_updates(self, connection: ClientConnection) -> None:
        """Send the complete state, and then changes."""
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
                    self._told.will_send(state)
                    await send("task_state_update", state)
                    self._told.has_sent(state)
                    entries = self._api.histories[name].log
                    new = [entry for entry in entries if entry["seq"] >= logged.get(name, 0)]
                    if new:
                        logged[name] = new[-1]["seq"] + 1
                        await send("task_log_update", task_log(name, new))
                for name in sent.keys() - self._states.keys():
                    sent.pop(name)
                    logged.pop(name, None)
                for state in self._told.not_among(self._states):
                    row = self._client.job(state["booking"]["id"])
                    if row is not None or self._observer.caught_up:
                        ended = last_state(state, row.state if row is not None else "")
                        await send("task_state_update", ended)
                        self._told.has_sent(ended)
                await anyio.sleep(LOOK_S)


def _say(text: str) -> None:
    click.echo(f"rmf: {text}".encode("ascii", "backslashreplace").decode(), err=True)


def _now_ms() -> int:
    return time.time_ns() // 1_000_000
