"""The configuration of one robot, fixed for the life of its agent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.engine import FASTEST, Engine
from mrbt_mesh.core.facts.store import Entry, Version
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.planning.deadlines import Due
from mrbt_mesh.core.planning.plan import RobotAssignment


@dataclass(frozen=True)
class ResumedLife:
    """A life that goes on where a recording has left it; the restored entries have the rest.

    `version`: that of the batch that it writes next. `assignment` and `partners`: its own in the
    newest plan. `deadlines_us`: when the running deadlines pass, from now on.
    """

    version: Version
    assignment: RobotAssignment | None
    partners: tuple[str, ...]
    deadlines_us: Mapping[Due, int]


@dataclass(frozen=True)
class AgentConfig:
    """One robot's configuration; performances in `capabilities` are micro-units.

    `expected`: the robots of the team that should be heard at the start; where nobody has joined
    yet, the robot waits for them up to `gather_us`, at least one detection time, and up to
    `alone_after_us` if it hears none at all. `listens`: where it does, for people. `takeover`: it
    replaces a live robot of the same id. `exit_when_done`: it stops once the whole team has the
    mission's result; otherwise it serves latecomers. `restored`: the entries of its journal;
    `keeps_journal`: it has one; `journal_problem`: why that cannot be written, empty if it can;
    `recording_problem`: the same of its recording. `plans_apart`: plans are made
    outside of `Agent.handle` (`deferred_inputs`). `lacks_planner`: it takes part in no mission that
    needs the extra of this name. With `keys` only messages that a member has
    signed are accepted; `life` is then greater than that of every earlier process of this robot
    (see `membership.envelope`). `resumed`: it goes on with a life that was recorded, without
    joining anew (the simulator's what-if).
    """

    robot: str
    type: str
    capabilities: dict[str, int]
    run: str
    nonce: str
    solver: Solver
    timing: Timing = field(default_factory=Timing)
    expected: frozenset[str] = frozenset()
    gather_us: int = 0
    alone_after_us: int = 0
    listens: str = "the network"
    takeover: bool = False
    exit_when_done: bool = False
    software: str = ""
    host: str = ""
    pid: int = 0
    restored: tuple[Entry, ...] = ()
    keeps_journal: bool = True
    journal_problem: str = ""
    recording_problem: str = ""
    engine: Engine = FASTEST
    plans_apart: bool = False
    lacks_planner: bool = False
    keys: Keys | None = None
    life: int = 0
    resumed: ResumedLife | None = None
