"""Many runs of a mission under a failure model: how often it succeeds, and how long it takes."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist, quantiles
from typing import Any, TypeAlias

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.parallel import spread
from mrbt_mesh.sim.run import SimulationResult, simulate
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs
from mrbt_mesh.sim.world.setup import FailureModel

PERCENTILES = (5, 25, 50, 75, 95)
CONFIDENCE = 0.95
# Every message takes as long: robots that hear something at the same time plan it only once.
NETWORK = NetworkKnobs(LinkKnobs(delay_us=1_500, jitter_us=0))
MILLION = 1_000_000
# The result of a run, and its duration in seconds.
RunOutcome: TypeAlias = tuple[str, float]


@dataclass(frozen=True)
class Experiment:
    """`runs` runs of a mission file with a program, in which `failures` happen by chance."""

    mission: str
    program: str
    failures: FailureModel
    runs: int
    seed: int = 0
    timeout_us: int = 600 * MILLION

    def seed_of(self, number: int) -> int:
        """The seed of one run, which `mrbt sim run --seed` takes as well."""
        return self.seed * MILLION + number


@functools.cache
def _load(path: str, program: str) -> tuple[Mission, RobotProgram]:
    return load_mission(Path(path)), load_program(program)


def run_one(experiment: Experiment, number: int) -> SimulationResult:
    """Run number `number` of an experiment."""
    return simulate(
        *_load(experiment.mission, experiment.program),
        seed=experiment.seed_of(number),
        network=NETWORK,
        timeout_us=experiment.timeout_us,
        stop_when_stuck=True,
        failures=experiment.failures,
        inspect=False,
    )


def _outcome(experiment: Experiment, number: int) -> RunOutcome:
    result = run_one(experiment, number)
    return result.result, result.summary["duration_s"] or 0.0  # None: nobody joined


def outcomes(experiment: Experiment, jobs: int) -> Iterator[RunOutcome]:
    """The outcomes of all runs, in the order in which they end.

    Raises SimulationError if an agent or a robot's program breaks.
    """
    return spread(functools.partial(_outcome, experiment), range(experiment.runs), jobs)


def wilson(successes: int, runs: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """The confidence interval of a probability of which `successes` of `runs` were seen.

    Source: Wilson, Probable inference, 1927; it keeps to 0..1 and holds near 0 and 1.
    """
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    share, square = successes / runs, z * z
    middle = (share + square / (2 * runs)) / (1 + square / runs)
    spread_by = math.sqrt(share * (1 - share) / runs + square / (4 * runs * runs))
    half = z / (1 + square / runs) * spread_by
    return max(0.0, middle - half), min(1.0, middle + half)


def summarise(found: Iterable[RunOutcome]) -> dict[str, Any]:
    """The statistics of at least one run as plain data, the same for any order of the outcomes.

    `duration_s`: percentiles of those that succeeded, in seconds; None without any.
    """
    runs = list(found)
    durations_s = sorted(duration_s for result, duration_s in runs if result == "success")
    low, high = wilson(len(durations_s), len(runs))
    share = {"probability": len(durations_s) / len(runs), "low": low, "high": high}
    several = durations_s if len(durations_s) > 1 else durations_s * 2  # one is all its quantiles
    cuts = quantiles(several, n=20, method="inclusive") if several else []
    named = {f"p{p}": round(cuts[p // 5 - 1], 6) for p in PERCENTILES if cuts}
    return {
        "runs": len(runs),
        "results": dict(sorted(Counter(result for result, _ in runs).items())),
        "success": {name: round(value, 6) for name, value in share.items()},
        "duration_s": named or None,
    }
