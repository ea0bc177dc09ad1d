"""A client of a team: whom it asks, and when what it submits is kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import anyio

from mrbt_mesh.core.agent.job_desk import KEPT_JOBS
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.team_client import TeamClient
from tests.support.paths import mission_file

MISSION = load_mission(mission_file("deliveries"))
Answer = Callable[[str, str, dict[str, Any]], tuple[bool, str]]


def client_of(*robots: str, answer: Answer) -> TeamClient:
    """A client of these robots, which answer (robot, command, argument)."""

    async def command(robot: str, name: str, argument: str) -> tuple[bool, str]:
        await anyio.lowlevel.checkpoint()
        return answer(robot, name, json.loads(argument))

    members = SimpleNamespace(members=lambda: list(robots))
    observer = SimpleNamespace(mission=MISSION, membership=members)
    return TeamClient(SimpleNamespace(observer=observer, command=command))  # type: ignore[arg-type]


async def changed(client: TeamClient) -> dict[str, Any]:
    async with anyio.create_task_group() as group:
        group.start_soon(client.ask_for_kept)
        state = await client.change("one", "cancel")
        group.cancel_scope.cancel()
    return state


def test_a_change_is_kept_only_by_robots_that_have_heard_of_it() -> None:
    heard = {"A": 2, "B": 1, "C": 1, "D": 2, "E": 1}
    asked: list[str] = []

    def answer(robot: str, name: str, argument: dict[str, Any]) -> tuple[bool, str]:
        if name != KEPT_JOBS:
            return True, json.dumps({"id": "one", "state": "cancelled", "stamp": 2})
        asked.append(robot)
        kept = [job for job, stamp in argument["ids"].items() if stamp <= heard[robot]]
        # Only later it comes to hear of the change.
        heard[robot] = 2 if asked.count(robot) > 2 else heard[robot]
        return True, json.dumps({"kept": kept})

    assert anyio.run(changed, client_of(*heard, answer=answer))["state"] == "cancelled"
    assert sum(stamp == 2 for stamp in heard.values()) >= len(MISSION.robots) // 2 + 1


def test_a_strange_answer_is_no_answer() -> None:
    strange = iter(["", "[]", "[" * 100_000, "{"])

    def answer(robot: str, name: str, argument: dict[str, Any]) -> tuple[bool, str]:
        if robot == "A":
            return True, next(strange, "null")
        kept = {"kept": list(argument.get("ids", ()))}
        return True, json.dumps(kept | {"id": "one", "state": "held", "stamp": 1})

    assert anyio.run(changed, client_of("A", "B", "C", "D", "E", answer=answer))["state"] == "held"
