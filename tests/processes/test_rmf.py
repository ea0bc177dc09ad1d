"""A team that is a fleet of an Open-RMF server, which is written from the schemas alone."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable
from typing import Any

from websockets.asyncio.server import ServerConnection, serve

from tests.support.paths import mission_file
from tests.support.rmf import response_to, validator
from tests.support.team import WAIT_S, Team

Message = dict[str, Any]


class Server:
    """Holds every message of one connection against its schema, and asks for tasks."""

    def __init__(self, connection: ServerConnection) -> None:
        self._connection = connection
        self.updates: list[Message] = []

    async def wait_for(self, kind: str, holds: Callable[[Message], Any]) -> Message:
        """The first update of a type whose data is so, also of those that came before."""
        seen = 0
        while True:
            for update in self.updates[seen:]:
                if update["type"] == kind and holds(update["data"]):
                    found: Message = update["data"]
                    return found
            seen = len(self.updates)
            await self._receive()

    async def ask(self, request: Message) -> Message:
        """The response to a request."""
        validator(request["type"]).validate(request)
        await self._connection.send(json.dumps(request))
        while (response := await self._receive()) is None:
            pass
        validator(response_to(request["type"])).validate(response)
        return response

    async def send_wrong(self, text: str) -> Message:
        """The response to what is no request."""
        await self._connection.send(text)
        while (response := await self._receive()) is None:
            pass
        validator("simple_response").validate(response)
        return response

    async def _receive(self) -> Message | None:
        """The next message, unless it is an update."""
        message: Message = json.loads(await self._connection.recv())
        kind = message.get("type", "")
        if not kind.endswith("_update") or kind == "task_discovery_update":
            return message
        validator(kind).validate(message)
        self.updates.append(message)
        return None


def dispatch(where: str, name: str) -> Message:
    request = {
        "category": "inspect",
        "description": {"where": where},
        "labels": [f"id={name}", "dashboard"],
        "requester": "anna",
    }
    return {"type": "dispatch_task_request", "request": request}


async def walk(team: Team, server: Server) -> None:
    """One task to its completion, another one that is cancelled, and what is no request."""

    def is_now(name: str, status: str) -> Callable[[Message], bool]:
        return lambda data: data["booking"]["id"] == name and data["status"] == status

    fleet = await server.wait_for("fleet_state_update", lambda data: len(data["robots"]) == 6)
    assert fleet["robots"]["D1"]["status"] == "idle"
    assert fleet["robots"]["D1"]["location"]["map"] == "deliveries"
    discovered = await server.ask({"type": "task_discovery_request"})
    assert [task["category"] for task in discovered["data"]["tasks"]] == ["deliver", "inspect"]
    team.hold("look")
    dispatched = await server.ask(dispatch("shelf_2", "one"))
    assert dispatched["state"]["booking"]["requester"] == "anna"
    await server.wait_for("task_state_update", is_now("one", "underway"))
    team.release()
    done = await server.wait_for("task_state_update", is_now("one", "completed"))
    assert done["unix_millis_start_time"] <= done["unix_millis_finish_time"]
    await server.wait_for("task_log_update", lambda data: "running" in data["log"][-1]["text"])
    team.hold("look")
    await server.ask(dispatch("shelf_3", "two"))
    work = await server.wait_for("task_state_update", is_now("two", "underway"))
    assert work["assigned_to"]["name"] in ("D1", "D2")
    robot = work["assigned_to"]["name"]
    await server.wait_for(
        "fleet_state_update", lambda data: data["robots"][robot].get("task_id") == "two"
    )
    cancel = {"type": "cancel_task_request", "task_id": "two", "labels": ["dashboard"]}
    assert (await server.ask(cancel))["success"]
    cancelled = await server.wait_for(
        "task_state_update", lambda data: is_now("two", "canceled")(data) and "cancellation" in data
    )
    assert cancelled["cancellation"]["labels"] == ["dashboard"]
    log = await server.ask({"type": "task_log_request", "task_id": "two"})
    assert log["data"]["log"][-1]["text"].startswith("cancelled")
    for text in ("no json", "{}", json.dumps({"type": "cancel_task_request"})):
        assert not (await server.send_wrong(text))["success"]
    refused = await server.ask(dispatch("moon", "three"))
    assert "where is one of" in refused["errors"][0]["detail"]


async def serving(team: Team) -> list[Server]:
    """Serve one connection for all of that, and another one after it was cut."""
    servers: list[Server] = []
    ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def take(connection: ServerConnection) -> None:
        server = Server(connection)
        servers.append(server)
        try:
            if len(servers) == 1:
                return await walk(team, server)
            await server.wait_for("task_state_update", lambda data: data["booking"]["id"] == "two")
            ended.set_result(None)
        except BaseException as error:
            if not ended.done():
                ended.set_exception(error)
            raise

    async with serve(take, "127.0.0.1", 0) as listening:
        port = listening.sockets[0].getsockname()[1]
        uri = f"ws://127.0.0.1:{port}/_internal"
        process = team.start("serve", "--run-dir", str(team.run_dir), "--rmf", uri)
        try:
            await asyncio.wait_for(ended, WAIT_S)
        finally:
            process.terminate()
            said = (await asyncio.to_thread(process.communicate))[1]
            sys.stderr.write(said)
        assert f"wrong message number 1 from {uri}: it is not JSON" in said
        assert "the connection has ended; trying again" in said
    return servers


def test_a_client_runs_one_task_and_cancels_another(team: Team) -> None:
    team.up(mission_file("deliveries"), speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    assert len(asyncio.run(serving(team))) == 2
