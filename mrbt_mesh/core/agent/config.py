"""The configuration of one robot, fixed for the lifetime of its agent."""

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
    """An incarnation that continues where its recording ends; the restored entries contain the rest
    of its state.

    `version`: of the next batch that it writes. `assignment` and `partners`: its own in the newest
    plan. `deadlines_us`: when the running deadlines pass, relative to now.
    """

    version: Version
    assignment: RobotAssignment | None
    partners: tuple[str, ...]
    deadlines_us: Mapping[Due, int]


@dataclass(frozen=True)
class AgentConfig:
    """One robot's configuration. Performances in `capabilities` are in micro-units.

    `expected`: the robots of the team that should be heard at the start. While nobody has joined
    yet, the robot waits for them up to `gather_us`, at least one detection time, and up to
    `alone_after_us` if it hears none at all. `listens`: where it listens, as a text for people.
    `takeover`: it replaces a live robot of the same id. `exit_when_done`: it stops once the whole
    team has the mission's result; otherwise it serves latecomers. `restored`: the entries of its
    journal. `keeps_journal`: it has a journal. `journal_problem`: why the journal cannot be
    written, empty if it can; `recording_problem`: the same for its recording. `plans_apart`: plans
    are made outside of `Agent.handle` (`deferred_inputs`). `lacks_planner`: the robot takes part in
    no mission that needs the extra `planner`. With `keys` only messages authenticated as coming
    from a member are accepted; `life` must then be greater than that of every earlier process of
    this robot (see `membership.envelope`). `resumed`: the robot continues a recorded incarnation
    without joining again (for the simulator's what-if).
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
