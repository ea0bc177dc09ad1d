"""*Check Consistency* after one event: brought up to date, from scratch, and by its definition."""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from benchmarks.registry import Benchmark, Result, Setting, Table
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.incremental.consistency.keeper import ConsistencyKeeper
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker
from mrbt_mesh.core.planning.consistency import Consistency, kept_requests, shortages
from mrbt_mesh.core.planning.demands import Demand
from tests.support.consistency_stories import WORKER, facts

NOTE = (
    "N robots and N requests of 1 to 3 robots each, in tree order; about half of "
    "the requests can be kept. Sparse: 10 capable robots per request; dense: all. "
    "With pins, half of the matched robots run what they are matched to. Each event is "
    "answered by all that are compared, one after the other; only the answers are "
    "timed. The definition (core/planning/consistency.py) takes seconds at "
    "1000 robots, so it answers few of the events there."
)

SIZES = (6, 50, 200, 1_000)
EVENTS = ("death", "return", "outcome", "request gone", "new request", "claim")
Answer = tuple[list[int], dict[str, int]]
Groups = list[list[Demand]]
Team = dict[str, Worker]


class Case:
    """A team and its requests; each event leaves what it does not concern the same objects."""

    def __init__(self, size: int, dense: bool, pins: bool, seed: int) -> None:
        self._random = random.Random(seed)
        self.robots = [f"r{number:04}" for number in range(size)]
        self.team = dict.fromkeys(self.robots, WORKER)
        self._dense = dense
        self._count = 0
        self._everybody = dict.fromkeys(self.robots, 1)
        self.groups = [self._request() for _ in range(size)]
        if pins:
            for robot, index in self._matching().items():
                if self._random.random() < 0.5:
                    self._claim(robot, index)

    def _request(self) -> list[Demand]:
        self._count += 1
        needed = self._random.randint(1, 3)
        some = self._everybody
        if not self._dense:
            chosen = self._random.sample(self.robots, min(10, len(self.robots)))
            some = dict.fromkeys((r for r in chosen if r in self.team), 1)
        request = Request(self._count, "calm", f"a{self._count}")
        return [Demand(request, f"k{self._count}", needed, needed, needed + 2, (), some)]

    def _matching(self) -> dict[str, int]:
        """A way to serve the requests that are kept."""
        check = Consistency(self.team)
        pinned = {r: i for i, (demand,) in enumerate(self.groups) for r in demand.pinned}
        for index, group in enumerate(self.groups):
            check.keep(index, group, pinned)
        return check.matched

    def _claim(self, robot: str, index: int) -> None:
        (demand,) = self.groups[index]
        self.groups[index] = [replace(demand, pinned=(*demand.pinned, robot))]

    def _without(self, demand: Demand, robot: str, some: dict[str, int]) -> list[Demand]:
        pinned = tuple(each for each in demand.pinned if each != robot)
        return [replace(demand, pinned=pinned, candidates=some)]

    def happen(self, event: str) -> None:
        """One event of EVENTS."""
        draw = self._random
        self.groups = list(self.groups)
        kept, _ = by_definition(self.groups, self.team)
        if event == "death":
            self._die(draw.choice(list(self.team)))
        elif event == "return":
            self._come()
        elif event == "outcome":
            self._finish(draw.choice([i for i in kept if self.groups[i][0].lower]))
        elif event == "request gone":
            del self.groups[draw.choice(kept)]
        elif event == "new request":
            self.groups.insert(draw.randint(0, len(self.groups)), self._request())
        else:
            matching = self._matching()
            self._claim(*draw.choice(sorted(matching.items())) if matching else (self.robots[0], 0))

    def _die(self, robot: str) -> None:
        self.team = {each: WORKER for each in self.team if each != robot}
        self._everybody = {each: 1 for each in self._everybody if each != robot}
        for index, (demand,) in enumerate(self.groups):
            if robot in demand.candidates:
                some = self._everybody if self._dense else dict(demand.candidates)
                some.pop(robot, None)
                self.groups[index] = self._without(demand, robot, some)

    def _come(self) -> None:
        away = [robot for robot in self.robots if robot not in self.team]
        if not away:
            return
        robot = self._random.choice(away)
        self.team = {each: WORKER for each in self.robots if each in self.team or each == robot}
        self._everybody = dict.fromkeys(self.team, 1)
        able = list(range(len(self.groups)))
        if not self._dense:
            able = self._random.sample(able, min(10, len(able)))
        for index in able:
            (demand,) = self.groups[index]
            some = self._everybody if self._dense else {**demand.candidates, robot: 1}
            self.groups[index] = [replace(demand, candidates=some)]

    def _finish(self, index: int) -> None:
        """A robot succeeds in what it runs, or in what it might have been put on."""
        (demand,) = self.groups[index]
        robot = self._random.choice(list(demand.pinned or demand.candidates))
        some = {each: 1 for each in demand.candidates if each != robot}
        (ended,) = self._without(demand, robot, some)
        self.groups[index] = [replace(ended, lower=demand.lower - 1)]


FACTS = facts()


def timed(function: Callable[..., Answer], *args: Any) -> tuple[Answer, float]:
    """An answer and the milliseconds of processor time that it took."""
    start = time.thread_time()
    answer = function(*args)
    return answer, (time.thread_time() - start) * 1e3


def measure(size: int, dense: bool, pins: bool, events: int, plain: int) -> dict[str, Any]:
    """Medians over the events of one case, in milliseconds, and ratios of medians."""
    case, keeper = Case(size, dense, pins, seed=1), ConsistencyKeeper()
    keeper.kept_requests(FACTS, case.groups, case.team)
    kept_up: dict[str, list[float]] = {event: [] for event in EVENTS}
    scratch: list[float] = []
    plainly: list[float] = []
    short: list[float] = []
    for number in range(events):
        event = EVENTS[number % len(EVENTS)]
        case.happen(event)
        groups, team = case.groups, case.team
        found, kept_up_ms = timed(keeper.kept_requests, FACTS, groups, team)
        again, scratch_ms = timed(ConsistencyKeeper().kept_requests, FACTS, groups, team)
        assert found == again, f"{size} robots, event {number}: {event}"
        kept_up[event].append(kept_up_ms)
        scratch.append(scratch_ms)
        kept = set(found[0])
        waiting = [group for index, group in enumerate(groups) if index not in kept]
        capabilities = Capabilities(dict(team))
        start = time.thread_time()
        for group in waiting:
            shortages(FACTS, group, capabilities)
        short.append((time.thread_time() - start) * 1e3)
        if number < plain:
            defined, plain_ms = timed(by_definition, groups, team)
            assert found == defined, f"{size} robots, event {number}: {event}"
            plainly.append(plain_ms)
    every = [ms for each in kept_up.values() for ms in each]
    medians = {
        "incremental_ms": statistics.median(every),
        "scratch_ms": statistics.median(scratch),
        "definition_ms": statistics.median(plainly),
        "shortages_ms": statistics.median(short),
    }
    return {
        "robots": size,
        "pairs": "dense" if dense else "sparse",
        "pins": pins,
        "kept": len(kept),
        **medians,
        "scratch_over_incremental": medians["scratch_ms"] / medians["incremental_ms"],
        "definition_over_scratch": medians["definition_ms"] / medians["scratch_ms"],
        "events_ms": {event: statistics.median(ms) for event, ms in kept_up.items()},
    }


def by_definition(groups: Groups, team: Team) -> Answer:
    return kept_requests(FACTS, groups, lambda: Consistency(team))


def tables(rows: list[dict[str, Any]]) -> list[Table]:
    """All events together against the others, and each kind of event by itself."""
    names = ("incremental_ms", "scratch_ms", "definition_ms", "shortages_ms")
    ratios = ("scratch_over_incremental", "definition_over_scratch")
    every, each = [], []
    for row in rows:
        case = (str(row["robots"]), row["pairs"] + (", pins" if row["pins"] else ""))
        figures = [f"{row[name]:.3f}" for name in names] + [f"{row[name]:.1f}" for name in ratios]
        every.append((*case, str(row["kept"]), *figures))
        each.append((*case, *(f"{ms:.3f}" for ms in row["events_ms"].values())))
    head = ("kept up", "scratch", "definition", "shortages", "scratch / kept up", "def. / scratch")
    return [
        Table("Check Consistency after one event, ms", ("robots", "pairs", "kept", *head), every),
        Table("Kept up to date, by event, ms", ("robots", "pairs", *EVENTS), each),
    ]


def run(setting: Setting) -> Result:
    rows = []
    for size in SIZES[: 3 if setting.quick else None]:
        plain = 1 if size >= 1_000 or setting.quick else 6
        for dense in (False, True):
            for pins in (False, True):
                rows.append(measure(size, dense, pins, 12 if setting.quick else 60, plain))
        setting.say(f"  {size} robots")
    return Result("from scratch", rows, tables(rows), notes=[NOTE])


BENCHMARK = Benchmark("*Check Consistency* after one event, and from scratch", run)
