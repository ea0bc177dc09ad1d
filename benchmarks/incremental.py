"""One event: the optimum kept up to date, and solved again."""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from benchmarks.registry import Benchmark, Result, Setting, Table
from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.solve import optimum
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.incremental.assignment.reassign import Reassigner

NOTE = (
    "Demands are offered, each for 1..3 robots up to 5, and kept in order while "
    "they can be served together: as many as there are robots, so that none is "
    "spare, or 0.3 times as many. Sparse: 10 robots can do a demand; dense: all "
    "can. An event may change which demands are kept, and so come with some more "
    "changes. After every event both are timed on the same problem, in turn; a "
    "ratio below 1 means that keeping is faster. CPU time of one thread; medians."
)

CAPABLE = 10
MICRO = 1_000_000
SIZES = (6, 50, 200, 1_000)
PERFORMANCES = (1_000, 10, 1)
OFFERED = (1.0, 0.3)  # per robot
EVENTS = ("death", "return", "request", "end", "outcome")


@dataclass
class World:
    """All that is offered, and the robots that are alive."""

    random: random.Random
    names: list[str]
    dense: bool
    most: int
    robots: list[str] = field(default_factory=list)
    offered: list[NamedDemand] = field(default_factory=list)
    count: int = 0

    def offer(self) -> NamedDemand:
        self.count += 1
        rng = self.random
        lower = rng.randint(1, 3)
        able = self.names if self.dense else rng.sample(self.names, min(CAPABLE, len(self.names)))
        candidates = {robot: rng.randint(1, self.most) * MICRO for robot in able}
        return NamedDemand(f"d{self.count}", lower, rng.randint(lower, 5), candidates)

    def team(self) -> NamedProblem:
        """With the demands that are kept."""
        alive, places = set(self.robots), Places()
        kept = [demand for demand in self.offered if places.keep(demand, alive, self.dense)]
        return NamedProblem(tuple(self.robots), tuple(kept))

    def happen(self, event: str, team: NamedProblem) -> None:
        rng = self.random
        if event == "death":
            self.robots.remove(rng.choice(self.robots))
        elif event == "return":
            away = sorted(set(self.names) - set(self.robots))
            self.robots = sorted([*self.robots, rng.choice(away)])
        elif event == "request":
            self.offered.insert(rng.randint(0, len(team.demands)), self.offer())
        elif event == "end":
            self.offered.remove(rng.choice(team.demands))
        else:
            old = rng.choice(team.demands)
            able = sorted(old.candidates.keys() & set(self.robots))
            candidates = dict(old.candidates)
            del candidates[rng.choice(able)]
            new = replace(
                old, lower=max(0, old.lower - 1), upper=old.upper - 1, candidates=candidates
            )
            self.offered[self.offered.index(old)] = new


class Places:
    """Which robots hold a place of a lower bound: augmenting paths, one robot per place."""

    def __init__(self) -> None:
        self.holds: dict[str, str] = {}
        self.able: dict[str, list[str]] = {}
        self.total = 0

    def keep(self, demand: NamedDemand, alive: set[str], dense: bool) -> bool:
        if dense:
            fits = self.total + demand.lower <= len(alive)
            self.total += demand.lower * fits
            return fits
        self.able[demand.id] = [robot for robot in demand.candidates if robot in alive]
        before = dict(self.holds)
        if all(self._augment(demand.id) for _ in range(demand.lower)):
            return True
        self.holds = before
        return False

    def _augment(self, start: str) -> bool:
        reached: dict[str, str] = {}
        came_by = {start: ""}
        queue = [start]
        for demand in queue:
            for robot in self.able[demand]:
                if robot in reached:
                    continue
                reached[robot] = demand
                holder = self.holds.get(robot)
                if holder is None:
                    while robot:
                        self.holds[robot] = reached[robot]
                        robot = came_by[reached[robot]]
                    return True
                if holder not in came_by:
                    came_by[holder] = robot
                    queue.append(holder)
        return False


def timed(work: Callable[[], object]) -> tuple[object, float]:
    start = time.thread_time()
    result = work()
    return result, (time.thread_time() - start) * 1e3


@dataclass
class Case:
    robots: int
    dense: bool
    most: int
    share: float  # of demands offered, per robot

    def __str__(self) -> str:
        values = f"1..{self.most}" if self.most > 1 else "all equal"
        return f"{self.robots} {'dense' if self.dense else 'sparse'}, {values}, {self.share}"

    def run(self, events: int, seconds: float, seed: int) -> Iterator[tuple[str, float, float]]:
        """(event, ms kept up to date, ms from scratch); ends early when the time is over."""
        end = time.monotonic() + seconds
        names = [f"r{number:05d}" for number in range(self.robots)]
        world = World(random.Random(seed), names, self.dense, self.most, list(names))
        world.offered = [world.offer() for _ in range(max(2, round(self.share * len(names))))]
        reassigner = Reassigner(scratch)
        team = world.team()
        reassigner.update(team)
        for number in range(events * len(EVENTS)):
            event = EVENTS[number % len(EVENTS)]
            world.happen(event, team)
            team = world.team()
            reassigner.prepare()
            update, again = partial(reassigner.update, team), partial(scratch, team)
            if number % 2:
                (kept, kept_ms), (solved, scratch_ms) = timed(update), timed(again)
            else:
                (solved, scratch_ms), (kept, kept_ms) = timed(again), timed(update)
            if kept != solved:
                raise RuntimeError(f"not the same as from scratch: {self}, {seed=}, {number=}")
            yield event, kept_ms, scratch_ms
            if time.monotonic() > end and number >= len(EVENTS) - 1:
                return


def scratch(team: NamedProblem) -> dict[str, str] | None:
    return optimum(team, default_solver)


def summary(case: Case, rows: list[tuple[str, float, float]]) -> list[dict[str, Any]]:
    result = []
    for event in (*EVENTS, "all"):
        mine = [row for row in rows if event in (row[0], "all")]
        if mine:
            kept = statistics.median(row[1] for row in mine)
            scratch = statistics.median(row[2] for row in mine)
            result.append(
                {
                    "robots": case.robots,
                    "dense": case.dense,
                    "most": case.most,
                    "offered_per_robot": case.share,
                    "event": event,
                    "count": len(mine),
                    "kept_ms": kept,
                    "kept_worst_ms": max(row[1] for row in mine),
                    "scratch_ms": scratch,
                    "ratio": kept / scratch,
                }
            )
    return result


def table(results: Sequence[Mapping[str, Any]]) -> Table:
    rows = []
    for row in results:
        values = f"1..{row['most']}" if row["most"] != 1 else "all 1"
        kind = (str(row["robots"]), "dense" if row["dense"] else "sparse")
        demands = f"{row['offered_per_robot']} per robot"
        figures = [f"{row[key]:.3f}" for key in ("kept_ms", "kept_worst_ms", "scratch_ms")]
        rows.append((*kind, demands, values, str(row["event"]), *figures, f"{row['ratio']:.2f}"))
    head = ("robots", "density", "offered", "p", "event", "kept", "worst", "from scratch", "ratio")
    return Table("The optimum after one event, ms", head, rows)


def run(setting: Setting) -> Result:
    sizes = SIZES[: 3 if setting.quick else None]
    events, seconds = (4, 5.0) if setting.quick else (20, 40.0)
    results: list[dict[str, Any]] = []
    for robots in sizes:
        for dense in (False, True):
            for share in OFFERED:
                for most in PERFORMANCES:
                    case = Case(robots, dense, most, share)
                    results += summary(case, list(case.run(events, seconds, setting.seed)))
            setting.say(f"  {robots} robots, {'dense' if dense else 'sparse'}")
    overall = [row for row in results if row["event"] == "all"]
    return Result("from scratch", results, [table(overall)], notes=[NOTE])


BENCHMARK = Benchmark("one event: the optimum kept up to date, and solved again", run)
