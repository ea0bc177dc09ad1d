"""Many chaos runs, in several processes: one verdict per seed."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.chaos.draw import ChaosKnobs, chaos, draw_knobs
from mrbt_mesh.sim.chaos.generate import generate_mission
from mrbt_mesh.sim.parallel import spread
from mrbt_mesh.sim.run import SimulationError, run_scenario
from mrbt_mesh.sim.world.scenario import Scenario

CRASH = "crash"
# In what share of the generated missions the team gets revisions.
REVISED = 0.15


@dataclass(frozen=True)
class Source:
    """Where a campaign's missions come from: one file, or (None) a generated one per seed.

    `program` is the robots' program of the file. `knobs` are the usual ones, of which each
    seed draws its own.
    """

    mission: str | None = None
    program: str | None = None
    speed: float = 1.0
    knobs: ChaosKnobs = field(default_factory=ChaosKnobs)

    def load(self, seed: int) -> tuple[Mission, RobotProgram]:
        """The mission of one seed and its robots' program."""
        if self.mission is None:
            generated = generate_mission(seed)
            return generated.mission, generated.program
        assert self.program is not None
        return _load(self.mission, self.program)

    def scenario(self, seed: int, mission: Mission) -> Scenario:
        """The chaos of one seed."""
        knobs = draw_knobs(seed, len(mission.robots), self.knobs)
        if self.mission is None:
            knobs = dataclasses.replace(knobs, revisions=max(knobs.revisions, REVISED))
        return chaos(mission, seed, knobs, self.speed)


@functools.cache
def _load(mission: str, program: str) -> tuple[Mission, RobotProgram]:
    return load_mission(Path(mission)), load_program(program)


@dataclass(frozen=True)
class Verdict:
    """What came of one seed. `result` is `crash` where an agent, a program or the simulator broke.

    `checks` counts what was checked, per invariant.
    """

    seed: int
    result: str
    violations: Sequence[str] = ()
    checks: Mapping[str, int] = field(default_factory=dict)
    done_twice: int = 0
    exclusive_done_twice: int = 0

    @property
    def invariants(self) -> frozenset[str]:
        """The names of those that broke."""
        return frozenset(text.partition(" ")[0] for text in self.violations)


def judge(mission: Mission, program: RobotProgram, scenario: Scenario) -> Verdict:
    """Run one scenario."""
    try:
        result = run_scenario(mission, program, scenario)
    except SimulationError as error:
        return Verdict(scenario.seed, CRASH, (f"{CRASH} {error}",))
    return Verdict(
        scenario.seed,
        result.result,
        tuple(result.violations),
        result.checks,
        result.done_twice,
        result.exclusive_done_twice,
    )


def run_seed(source: Source, seed: int) -> Verdict:
    """Draw the chaos of one seed and run it."""
    mission, program = source.load(seed)
    return judge(mission, program, source.scenario(seed, mission))


def campaign(source: Source, seeds: Iterable[int], jobs: int) -> Iterator[Verdict]:
    """The verdicts of all seeds, in the order in which they are done."""
    return spread(functools.partial(run_seed, source), seeds, jobs)
