"""A client of a team: whom it asks, and when what it submits is kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import anyio

from mrbt_mesh.core.agent.job_desk import KEPT_JOB
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


def test_a_change_is_kept_only_by_robots_that_have_heard_of_it() -> None:
    keepers = {"A", "D"}
    asked: list[str] = []

    def answer(robot: str, name: str, argument: dict[str, Any]) -> tuple[bool, str]:
        if name != KEPT_JOB:
            return True, json.dumps({"id": "one", "state": "cancelled", "stamp": 2})
        assert argument == {"id": "one", "stamp": 2}
        asked.append(robot)
        # The others come to hear of it only later.
        kept = robot in keepers or asked.count(robot) > 1
        return kept, json.dumps({"kept": kept})

    client = client_of(*"ABCDE", answer=answer)
    assert anyio.run(client.change, "one", "cancel")["state"] == "cancelled"
    assert len(asked) > len(MISSION.robots) // 2 + 1


def test_a_strange_answer_is_no_answer() -> None:
    strange = iter(["", "[]", "[" * 100_000, "{"])

    def answer(robot: str, name: str, argument: dict[str, Any]) -> tuple[bool, str]:
        if robot == "A":
            return True, next(strange, "null")
        return True, json.dumps({"kept": True, "id": "one", "state": "held", "stamp": 1})

    client = client_of(*"ABCDE", answer=answer)
    assert anyio.run(client.change, "one", "cancel")["state"] == "held"
