"""All that decides a run: the same setup gives the same run, effect for effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.engine import Engine
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Header
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.runtime.engine_choice import chosen_engine
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.world.failures import NO_FAILURES, FailureModel
from mrbt_mesh.sim.world.faults import Fault
from mrbt_mesh.sim.world.network import NetworkKnobs


@dataclass(frozen=True)
class AgentOptions:
    """How the robots' agents are set up, the same for all.

    `engine`: what they compute with; the definitions, where the environment asks for them.
    `solvers` are those of robots that have another one than `solver`. With `plan_delay_us` plans
    are made outside of the agents, and take so long. Without `exit_when_done` robots stay when
    the mission is over.
    """

    timing: Timing = field(default_factory=Timing)
    engine: Engine = field(default_factory=chosen_engine)
    solver: Solver = default_solver
    solvers: Mapping[str, Solver] = field(default_factory=dict)
    plan_delay_us: int | None = None
    exit_when_done: bool = True


@dataclass(frozen=True)
class Beginning:
    """Where a run goes on that has begun elsewhere: its id, and what its robots know.

    `under_way`: for how long, in microseconds, a robot has been at a local task of an activation;
    if it is given the same again it goes on from there.
    """

    run: str
    facts: tuple[Entry, ...]
    under_way: Mapping[tuple[str, str, str], int]


@dataclass(frozen=True)
class Setup:
    """One run. `robots` are launched at the start, within `start_spread_us`.

    `failures` come by chance, besides the faults of the `schedule`. `speed` shortens the robots'
    work. `timeout_us` counts from the launch. `stop_when_stuck`: end a run of which nothing more
    will come. `record`: the folder for what each robot and the observer record.
    `begin`: what has been before.
    """

    mission: Mission
    program: RobotProgram
    seed: int
    robots: tuple[str, ...]
    timeout_us: int
    schedule: tuple[tuple[int, Fault], ...] = ()
    failures: FailureModel = NO_FAILURES
    network: NetworkKnobs = field(default_factory=NetworkKnobs)
    agents: AgentOptions = field(default_factory=AgentOptions)
    speed: float = 1.0
    stop_when_stuck: bool = False
    start_spread_us: int = 20_000
    record: Path | None = None
    begin: Beginning | None = None

    @property
    def timing(self) -> Timing:
        """The times of a team of this size."""
        return self.agents.timing.of_team(len(self.mission.robots))

    @property
    def run(self) -> str:
        """The id of the run."""
        return self.begin.run if self.begin is not None else f"sim{self.seed}"

    @property
    def header(self) -> Header:
        """That of messages from outside of the team."""
        return Header(self.mission.digest[:16], self.mission.name, self.run, "")
