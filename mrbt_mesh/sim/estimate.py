"""Many runs of a mission under failure models: how often it succeeds, and how long it takes."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
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
from mrbt_mesh.sim.statistics.team_sizes import resized
from mrbt_mesh.sim.world.failures import FailureModel
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs

PERCENTILES = (5, 25, 50, 75, 95)
BINS = 20
CONFIDENCE = 0.95
# Every message takes as long: robots that hear something at the same time plan it only once.
NETWORK = NetworkKnobs(LinkKnobs(delay_us=1_500, jitter_us=0))
MILLION = 1_000_000


@dataclass(frozen=True)
class Point:
    """One setting of which many runs are made: a failure model and a team's size (None: the
    file's team). `values` say what of it was swept: (name, value as given).
    """

    failures: FailureModel
    robots: int | None = None
    values: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Experiment:
    """`runs` runs of each point. Run k has the same seed at every point, so that points differ
    by their settings and not by luck.
    """

    mission: str
    program: str
    points: tuple[Point, ...]
    runs: int
    seed: int = 0
    speed: float = 1.0
    timeout_us: int = 600 * MILLION

    def seed_of(self, number: int) -> int:
        """The seed of one run, which `mrbt sim --seed` takes as well."""
        return self.seed * MILLION + number


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """What came of one run; faults are counted until the mission was over."""

    point: int
    number: int
    result: str
    duration_us: int
    major_faults: int
    minor_faults: int


@functools.cache
def _load(path: str, program: str, size: int | None) -> tuple[Mission, RobotProgram]:
    mission = load_mission(Path(path))
    return mission if size is None else resized(mission, size), load_program(program)


def run_one(experiment: Experiment, point: Point, number: int) -> SimulationResult:
    """One run of one point."""
    mission, program = _load(experiment.mission, experiment.program, point.robots)
    failures = point.failures
    if (failures.major_faults or failures.minor_faults) and not failures.within_us:
        alone = (experiment.mission, experiment.program, experiment.seed, experiment.speed)
        failures = replace(failures, within_us=undisturbed_us(*alone, point.robots))
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
def undisturbed_us(mission: str, program: str, seed: int, speed: float, robots: int | None) -> int:
    """How long the mission takes a team to which nothing happens."""
    point = Point(FailureModel(), robots)
    return _duration_us(run_one(Experiment(mission, program, (), 1, seed, speed), point, 0))


def _duration_us(result: SimulationResult) -> int:
    duration_s = result.summary["duration_s"]  # None if no robot ever joined
    return 0 if duration_s is None else round(duration_s * MILLION)


def _outcome(experiment: Experiment, item: tuple[int, int]) -> RunOutcome:
    index, number = item
    result = run_one(experiment, experiment.points[index], number)
    faults = result.fault_counts.get("Kill", 0), result.fault_counts.get("Lose", 0)
    return RunOutcome(index, number, result.result, _duration_us(result), *faults)


def outcomes(experiment: Experiment, jobs: int) -> Iterator[RunOutcome]:
    """The outcomes of all runs of all points, in the order in which they are done.

    Raises SimulationError if an agent or a robot's program breaks.
    """
    items = ((i, k) for i in range(len(experiment.points)) for k in range(experiment.runs))
    return spread(functools.partial(_outcome, experiment), items, jobs)


# -- what the outcomes say --------------------------------------------------------------------


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
    """What the runs of one point say; `durations_s` are those of the successes, sorted."""

    point: Point
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
            **dict(self.point.values),
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


def summarise(experiment: Experiment, found: Sequence[RunOutcome]) -> list[Summary]:
    """A summary for each point that has runs, in the order of points; in any order of outcomes."""
    by_point: dict[int, list[RunOutcome]] = {}
    for outcome in sorted(found, key=lambda outcome: (outcome.point, outcome.number)):
        by_point.setdefault(outcome.point, []).append(outcome)
    return [_summary(experiment.points[index], some) for index, some in by_point.items()]


def _summary(point: Point, found: Sequence[RunOutcome]) -> Summary:
    results = Counter(outcome.result for outcome in found)
    durations = [o.duration_us / 1e6 for o in found if o.result == "success"]
    groups: dict[tuple[int, int], list[RunOutcome]] = {}
    for outcome in found:
        groups.setdefault((outcome.major_faults, outcome.minor_faults), []).append(outcome)
    by_faults = {}
    for key in sorted(groups):
        good = [o.duration_us / 1e6 for o in groups[key] if o.result == "success"]
        by_faults[key] = (len(groups[key]), len(good), fmean(good) if good else 0.0)
    return Summary(
        point,
        len(found),
        {name: results[name] for name in sorted(results)},
        tuple(sorted(durations)),
        fmean(outcome.major_faults for outcome in found),
        fmean(outcome.minor_faults for outcome in found),
        by_faults,
    )
