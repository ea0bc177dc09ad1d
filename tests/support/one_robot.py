"""The desk of one robot that takes jobs, and a client that it answers at once."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.job_desk import job_rules
from mrbt_mesh.core.agent.operator_desk import OperatorDesk, team_rules
from mrbt_mesh.core.agent.operator_messages import CommandStep, operate_body
from mrbt_mesh.core.agent.parts import Parts
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.feature import Kit
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.observer.job_log import JobLog
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.member_keys import MemberKeys
from mrbt_mesh.runtime.operator_call import Acknowledged
from mrbt_mesh.runtime.team_client import TeamClient
from tests.support.paths import mission_file

MISSION = load_mission(mission_file("deliveries"))
NOW_US = 1_000_000_000


def desk(
    keys: MemberKeys | None = None, clock_us: int | None = NOW_US, mission: Mission = MISSION
) -> tuple[OperatorDesk, Context]:
    """The desk of D1, whose clock shows this (None: it has not read it), and its facts."""
    config = AgentConfig("D1", "drone", {"look": 1_000_000}, "r", "n", default_solver, keys=keys)
    context = Context(mission, config, 0)
    context.replica.next_incarnation(0)
    assert context.wall_clock is not None
    assert context.facts.jobs is not None
    if clock_us is not None:
        context.wall_clock.read(clock_us, 0)
    planner = Planner(context, RobotTree({"look"}))
    parts = Parts(Kit(context, Health(context), planner, lambda *_: None, lambda _: []))
    parts.compose(0)
    of_features = [part.rules() for part in parts.all]
    own = team_rules(context), job_rules(context), *of_features
    rules = {field: rule for each in own for field, rule in each.items()}
    return OperatorDesk(context, rules), context


class DeskClient(TeamClient):
    """A client of that robot, which keeps everything; it does not answer about the job `silent`."""

    def __init__(self, mission: Mission = MISSION) -> None:
        self._desk, self.context = desk(mission=mission)
        context = self.context
        observer = SimpleNamespace(
            mission=mission,
            facts=context.facts,
            plan=None,
            record=SimpleNamespace(job_log=JobLog(mission), result=None),
            clock_ahead_us=lambda: NOW_US - boottime_us(),
            membership=SimpleNamespace(
                peers={
                    "D1": SimpleNamespace(
                        state=State.ALIVE, report=SimpleNamespace(has_joined=True)
                    )
                },
                members=lambda: ["D1"],
                clock_offsets_us=lambda: [NOW_US - boottime_us()],
            ),
            robots=lambda: ["D1"],
        )
        watcher = SimpleNamespace(
            observer=observer,
            operate=self._operate,
            make_command=lambda *given: make_command(*given, "r", None),
        )
        super().__init__(watcher)  # type: ignore[arg-type]

    async def _operate(
        self, robot: str, step: CommandStep, entry: Entry, passes_on: bool
    ) -> dict[str, Any] | None:
        answer = self._desk.take(operate_body(step, entry), 0)
        return answer.make() if isinstance(answer, AwaitedAnswer) else answer

    async def _command(self, *given: Any, **more: Any) -> Acknowledged:
        """It is one robot of six: its journal is enough."""
        name, value, operator, *_ = given
        if name.endswith("/silent"):
            raise TimeoutError("D1 does not answer")
        return await super()._command(name, value, operator, 1, **more)
