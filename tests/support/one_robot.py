"""The desk of one robot that takes jobs, and a client that it answers at once."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.job_desk import JobDesk
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.member_keys import MemberKeys
from mrbt_mesh.runtime.team_client import JobRefusedError, TeamClient
from tests.support.paths import mission_file

MISSION = load_mission(mission_file("deliveries"))
NOW_US = 1_000_000_000


def desk(keys: MemberKeys | None = None, clock_us: int | None = NOW_US) -> tuple[JobDesk, Context]:
    """The desk of D1, whose clock shows this (None: it has not read it), and its facts."""
    config = AgentConfig("D1", "drone", {"look": 1_000_000}, "r", "n", default_solver, keys=keys)
    context = Context(MISSION, config, 0)
    context.replica.next_incarnation(0)
    assert context.wall_clock is not None
    assert context.facts.jobs is not None
    if clock_us is not None:
        context.wall_clock.read(clock_us, 0)
    return JobDesk(context, context.facts.jobs), context


class DeskClient(TeamClient):
    """A client of that robot, which keeps everything; it does not answer about the job `silent`."""

    def __init__(self) -> None:
        self._desk, context = desk()
        observer = SimpleNamespace(
            mission=MISSION,
            facts=context.facts,
            plan=None,
            membership=SimpleNamespace(
                members=lambda: ["D1"], clock_offsets_us=lambda: [NOW_US - boottime_us()]
            ),
            robots=lambda: ["D1"],
        )
        watcher = SimpleNamespace(observer=observer, signed=lambda name, values: {})
        super().__init__(watcher)  # type: ignore[arg-type]

    async def _ask_any(self, command: str, given: dict[str, Any]) -> dict[str, Any]:
        if given["id"] == "silent":
            raise TimeoutError("D1 does not answer")
        answer: dict[str, Any] = json.loads(self._desk.answer(command, json.dumps(given), 0))
        if "refused" in answer:
            raise JobRefusedError(answer["refused"], answer["cause"])
        return answer

    async def _await_kept(self, name: str, stamp: int, safe: int | None) -> None:
        pass
