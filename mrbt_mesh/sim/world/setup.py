"""All that decides a run: the same setup gives the same run, effect for effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from mrbt_mesh.core.agent.config import ResumedLife
from mrbt_mesh.core.agent.effects import FeatureEffect
from mrbt_mesh.core.agent.inputs import ActionFinished, ConditionSet, FeatureInput
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.engine import Engine
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Header
from mrbt_mesh.core.mission.mission import Mission, Robot
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.solver_loader import chosen_engine
from mrbt_mesh.sim.world.faults import Fault
from mrbt_mesh.sim.world.network import NetworkKnobs

EVERYBODY = ""
# The Unix time at the launch of a team, in microseconds: in September 2001.
LAUNCH_UNIX_US = 1_000_000_000_000_000


@dataclass(frozen=True, slots=True)
class Rate:
    """How often there is a fault of a robot: with a chance (0 to 1) each time it completes an
    action, and at independent times, with this mean number per hour.
    """

    per_action: float = 0.0
    per_hour: float = 0.0


@dataclass(frozen=True)
class FailureModel:
    """What goes wrong how often.

    `major` (death) and `minor` (a capability is lost, any of those that are left alike) map a
    robot, a robot type or EVERYBODY to a rate; the most specific one counts. `actions` maps a
    local-task type or EVERYBODY to the chance that the action fails. `return_us` after its death a
    robot is started again with its journal, `repair_us` after its loss a capability is back; None:
    never.
    """

    major: Mapping[str, Rate] = field(default_factory=dict)
    minor: Mapping[str, Rate] = field(default_factory=dict)
    actions: Mapping[str, float] = field(default_factory=dict)
    return_us: int | None = None
    repair_us: int | None = None


NO_FAILURES = FailureModel()


def rate_of(rates: Mapping[str, Rate], robot: Robot) -> Rate:
    """The rate that counts for a robot."""
    for name in (robot.id, robot.type, EVERYBODY):
        if name in rates:
            return rates[name]
    return Rate()


@dataclass(frozen=True)
class AgentOptions:
    """How the robots' agents are set up, the same for all.

    `engine`: what they compute with; the definitions, where the environment asks for them.
    `solvers` are those of robots that have another one than `solver`. With `plan_delay_us` plans
    are made outside of the agents, and take so long. Without `exit_when_done` robots stay when
    the mission is over. `keys`: those of each robot, of operators by name, and of the observer as
    ""; none: the run has no keys. `record_limit_bytes`: of each recording, which has parts then.
    """

    timing: Timing = field(default_factory=Timing)
    engine: Engine = field(default_factory=chosen_engine)
    solver: Solver = default_solver
    solvers: Mapping[str, Solver] = field(default_factory=dict)
    plan_delay_us: int | None = None
    exit_when_done: bool = True
    keys: Mapping[str, Keys] = field(default_factory=dict)
    record_limit_bytes: int | None = None


# Robot, activation and local task.
Place: TypeAlias = tuple[str, str, str]


@dataclass(frozen=True)
class RecordedWork:
    """One run of a local task, as it was recorded; times in microseconds.

    `starts_us`: when it started, after the begin of this run; `begun_us`: for how long it had run
    by then already. `events`: what its robot said, and how long after its start here; the last one
    is its end. None: more is not known, the program goes on in its place.
    """

    starts_us: int = 0
    begun_us: int = 0
    events: tuple[tuple[int, ConditionSet | ActionFinished | None], ...] = ()


@dataclass(frozen=True)
class Beginning:
    """Where a recorded run goes on: its id, what its robots know, and the lives that go on.

    `works`: how a robot's runs of a local task of an activation went, in order; where it is given
    the same again, it goes the same way. `answer`: what a robot's program answered to what a
    feature asked it, None if it is not known. Else the program decides. `ways_us`: for how long
    robots have been on their way. `unix_us`: the Unix time.
    """

    run: str
    facts: tuple[Entry, ...]
    lives: Mapping[str, ResumedLife]
    works: Mapping[Place, Sequence[RecordedWork]]
    answer: Callable[[str, FeatureEffect], FeatureInput | None]
    ways_us: Mapping[str, int] = field(default_factory=dict)
    unix_us: int = LAUNCH_UNIX_US


@dataclass(frozen=True)
class Setup:
    """One run. `robots` are launched at the start, within `start_spread_us`.

    `failures` come by chance, besides the faults of the `schedule`. `speed` shortens the robots'
    work. `noise_permille`: up to so much longer or shorter than by the mission are works and ways.
    `timeout_us` counts from the launch. `stop_when_stuck`: end a run of which nothing more
    will come. `until_jobs_end`: end it when all of the schedule has happened, and all jobs that
    clients have submitted have ended. `record`: the folder for what each robot and the observer
    record. `begin`: what has been before.
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
    noise_permille: int = 0
    stop_when_stuck: bool = False
    until_jobs_end: bool = False
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
    def launch_unix_us(self) -> int:
        """The Unix time at the begin."""
        return self.begin.unix_us if self.begin is not None else LAUNCH_UNIX_US

    @property
    def header(self) -> Header:
        """That of messages from outside of the team."""
        return Header(self.mission.team_digest[:16], self.mission.name, self.run, "")
