"""Many runs of a mission under a failure model: how often it succeeds, and how long it takes."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist, fmean, stdev
from typing import Any

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.parallel import spread
from mrbt_mesh.sim.run import SimulationResult, simulate
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs
from mrbt_mesh.sim.world.setup import NO_FAILURES, FailureModel

PERCENTILES = (5, 25, 50, 75, 95)
BINS = 20
CONFIDENCE = 0.95
# Every message takes as long: robots that hear something at the same time plan it only once.
NETWORK = NetworkKnobs(LinkKnobs(delay_us=1_500, jitter_us=0))
MILLION = 1_000_000


@dataclass(frozen=True)
class Experiment:
    """`runs` runs of a mission file with a program, in which `failures` happen by chance."""

    mission: str
    program: str
    failures: FailureModel
    runs: int
    seed: int = 0
    speed: float = 1.0
    timeout_us: int = 600 * MILLION

    def seed_of(self, number: int) -> int:
        """The seed of one run, which `mrbt sim run --seed` takes as well."""
        return self.seed * MILLION + number


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """The outcome of one run; faults are counted until the mission is over."""

    number: int
    result: str
    duration_us: int
    major_faults: int
    minor_faults: int


@functools.cache
def _load(path: str, program: str) -> tuple[Mission, RobotProgram]:
    return load_mission(Path(path)), load_program(program)


def run_one(experiment: Experiment, number: int) -> SimulationResult:
    """Run number `number` of an experiment."""
    mission, program = _load(experiment.mission, experiment.program)
    failures = experiment.failures
    if (failures.major_faults or failures.minor_faults) and not failures.within_us:
        within_us = _undisturbed_us(
            experiment.mission, experiment.program, experiment.seed, experiment.speed
        )
        failures = replace(failures, within_us=within_us)
    return simulate(
        mission,
        program,
        seed=experiment.seed_of(number),
        network=NETWORK,
        timeout_us=experiment.timeout_us,
        speed=experiment.speed,
        stop_when_stuck=True,
        failures=failures,
        inspect=False,
    )


@functools.cache
def _undisturbed_us(mission: str, program: str, seed: int, speed: float) -> int:
    """How long the mission takes without failures."""
    return _duration_us(run_one(Experiment(mission, program, NO_FAILURES, 1, seed, speed), 0))


def _duration_us(result: SimulationResult) -> int:
    duration_s = result.summary["duration_s"]  # None if no robot ever joined
    return 0 if duration_s is None else round(duration_s * MILLION)


def _outcome(experiment: Experiment, number: int) -> RunOutcome:
    result = run_one(experiment, number)
    faults = result.fault_counts.get("Kill", 0), result.fault_counts.get("Lose", 0)
    return RunOutcome(number, result.result, _duration_us(result), *faults)


def outcomes(experiment: Experiment, jobs: int) -> Iterator[RunOutcome]:
    """The outcomes of all runs, in the order in which they end.

    Raises SimulationError if an agent or a robot's program breaks.
    """
    return spread(functools.partial(_outcome, experiment), range(experiment.runs), jobs)


# -- statistics -------------------------------------------------------------------------------


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


def percentile(ordered: Sequence[float], percent: float) -> float:
    """A percentile of sorted values, linear between two of them."""
    at = (len(ordered) - 1) * percent / 100
    low, high = math.floor(at), math.ceil(at)
    return ordered[low] + (ordered[high] - ordered[low]) * (at - low)


@dataclass(frozen=True)
class Summary:
    """Statistics of the runs; `durations_s` are those of the successes, sorted.

    `by_faults`: (major, minor faults) -> (runs, successes, mean duration of these in s).
    """

    runs: int
    results: Mapping[str, int]
    durations_s: tuple[float, ...]
    major_faults: float
    minor_faults: float
    by_faults: Mapping[tuple[int, int], tuple[int, int, float]]

    @property
    def successes(self) -> int:
        return self.results.get("success", 0)

    @property
    def probability(self) -> float:
        return self.successes / self.runs

    @property
    def interval(self) -> tuple[float, float]:
        return wilson(self.successes, self.runs)

    @property
    def mean_s(self) -> float | None:
        return fmean(self.durations_s) if self.durations_s else None

    def percentile_s(self, percent: float) -> float | None:
        return percentile(self.durations_s, percent) if self.durations_s else None

    def histogram(self, bins: int = BINS) -> tuple[list[float], list[int]]:
        """(edges, counts) of the durations; empty where no run succeeded."""
        if not self.durations_s:
            return [], []
        low, high = self.durations_s[0], self.durations_s[-1]
        width = (high - low) / bins or 1.0
        counts = [0] * bins
        for duration_s in self.durations_s:
            counts[min(bins - 1, int((duration_s - low) / width))] += 1
        return [low + width * k for k in range(bins + 1)], counts

    def to_json(self) -> dict[str, Any]:
        """Plain data; durations in seconds, of the successes."""
        low, high = self.interval
        edges, counts = self.histogram()
        spread_s = stdev(self.durations_s) if len(self.durations_s) > 1 else None
        duration: dict[str, Any] | None = None
        if self.durations_s:
            duration = {
                "mean": _rounded(self.mean_s),
                "standard_deviation": _rounded(spread_s),
                "min": _rounded(self.durations_s[0]),
                **{f"p{p}": _rounded(self.percentile_s(p)) for p in PERCENTILES},
                "max": _rounded(self.durations_s[-1]),
                "histogram": {"edges": [round(edge, 6) for edge in edges], "counts": counts},
            }
        return {
            "runs": self.runs,
            "results": dict(self.results),
            "success": {
                "probability": round(self.probability, 6),
                "low": round(low, 6),
                "high": round(high, 6),
                "confidence": CONFIDENCE,
            },
            "duration_s": duration,
            "faults_per_run": {
                "major": round(self.major_faults, 6),
                "minor": round(self.minor_faults, 6),
            },
            "by_faults": [
                {
                    "major": major,
                    "minor": minor,
                    "runs": runs,
                    "successes": successes,
                    "mean_duration_s": _rounded(mean_s) if successes else None,
                }
                for (major, minor), (runs, successes, mean_s) in self.by_faults.items()
            ],
        }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 6)


def summarise(found: Iterable[RunOutcome]) -> Summary:
    """The statistics of at least one run, the same for any order of the outcomes."""
    runs = sorted(found, key=lambda outcome: outcome.number)
    results = Counter(outcome.result for outcome in runs)
    groups: dict[tuple[int, int], list[RunOutcome]] = {}
    for outcome in runs:
        groups.setdefault((outcome.major_faults, outcome.minor_faults), []).append(outcome)
    by_faults = {}
    for faults, group in sorted(groups.items()):
        durations_s = _durations_s(group)
        mean_s = fmean(durations_s) if durations_s else 0.0
        by_faults[faults] = (len(group), len(durations_s), mean_s)
    return Summary(
        len(runs),
        dict(sorted(results.items())),
        tuple(sorted(_durations_s(runs))),
        fmean(outcome.major_faults for outcome in runs),
        fmean(outcome.minor_faults for outcome in runs),
        by_faults,
    )


def _durations_s(runs: Iterable[RunOutcome]) -> list[float]:
    return [each.duration_us / MILLION for each in runs if each.result == "success"]
