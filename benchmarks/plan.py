"""The whole plan after one event, beside one by the definition, which keeps nothing."""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmarks.large import LargeTeam, large_mission
from benchmarks.registry import Benchmark, Result, Setting, Table
from benchmarks.run import REPAIR
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.features.exclusive.kinds import DECISION
from mrbt_mesh.features.exclusive.records import CoalitionId
from mrbt_mesh.formats.mission_file import load_mission

# Robots and nodes; 0: the vehicle repair.
SIZES = ((0, 0), (200, 1_000), (1_000, 10_000))
# How many robots can do a job, where not all of them can.
SPARSE = 10
EVENTS, QUICK_EVENTS = 24, 8
REFERENCE = "nothing kept"


@dataclass
class Times:
    """Seconds per event: pruning and the next plan, and a plan for which nothing was kept."""

    next_s: list[float] = field(default_factory=list)
    plain_s: list[float] = field(default_factory=list)


def measured(function: Callable[[], Plan]) -> tuple[float, Plan]:
    """(the lesser of elapsed and CPU seconds, for the machine may be shared; the plan)."""
    started_s, cpu_s = time.perf_counter(), time.process_time()
    plan = function()
    return min(time.perf_counter() - started_s, time.process_time() - cpu_s), plan


class Story:
    """Events that befall a team, one after the other: at work, or before anybody has started."""

    def __init__(self, mission: Mission, seed: int, is_at_work: bool) -> None:
        self.team = LargeTeam(mission)
        self.plan = self.team.plan()
        self._is_at_work = is_at_work
        self._pick = random.Random(f"{seed}/{mission.name}")
        # Those that let a job be skipped; without the others the mission would fail.
        self._skips = sorted(name for name in mission.conditions if name.startswith("done"))
        self.after()

    def events(self, count: int) -> Iterator[Callable[[], None]]:
        """What lets each event happen."""
        kinds = [self._death]
        if self._is_at_work:
            kinds += [self._outcome, self._claim]
        if self._skips:
            kinds.append(self._condition)
        for number in range(count):
            yield kinds[number % len(kinds)]

    def after(self) -> None:
        """Robots that have died return, and where the team is at work all begin what is planned."""
        for robot in self.team.mission.robots:
            self.team.alive.setdefault(robot, Incarnation(1, "n"))
        self.plan = self.team.plan()
        if self._is_at_work:
            self._settle()

    @property
    def is_over(self) -> bool:
        """Whether there is nobody left to whom something could happen."""
        return not self._robots()

    def _settle(self) -> None:
        self.team.start(self.plan)
        self.plan = self.team.plan()
        while self.plan.assignments and not any(
            line.pinned for line in self.plan.assignments.values()
        ):
            # All of it are tasks by coalitions, which are passed over.
            line = next(iter(self.plan.assignments.values()))
            coalition = CoalitionId(1, line.robot, 1, "n")
            name = f"{DECISION}/{line.activation}/{coalition}"
            version = Version(Incarnation(1, "c"), 0)
            done = parse_entry(records.OPERATORS, name, version, ["done", "", "", ""])
            self.team.facts.map.merge([done])
            self.plan = self.team.plan()
            self.team.start(self.plan)
            self.plan = self.team.plan()

    def _robots(self) -> list[str]:
        """Those with an assignment; of a team at work, those that work on it."""
        lines = self.plan.assignments.items()
        return sorted(r for r, line in lines if line.pinned or not self._is_at_work)

    def _busy(self) -> str:
        return self._pick.choice(self._robots())

    def _outcome(self) -> None:
        self.team.finish(self.plan.assignments[self._busy()])

    def _claim(self) -> None:
        robot = self._busy()
        self.team.begin(self.plan.assignments[robot])

    def _death(self) -> None:
        del self.team.alive[self._busy()]

    def _condition(self) -> None:
        self.team.turn(self._pick.choice(self._skips), self._busy())


def measure(mission: Mission, events: int, seed: int, is_at_work: bool) -> Times:
    """Times per event. Raises AssertionError if the two plans ever differ."""
    story, times = Story(mission, seed, is_at_work), Times()
    for happen in story.events(events):
        if story.is_over:
            break
        happen()
        next_s, plan = measured(story.team.plan)
        plain_s, fresh = measured(story.team.plan_anew)
        assert plan.packed == fresh.packed, f"{mission.name}: seed {seed}, {happen.__name__}"
        times.next_s.append(next_s)
        times.plain_s.append(plain_s)
        story.after()
    return times


def run(setting: Setting) -> Result:
    rows: list[dict[str, Any]] = []
    events = QUICK_EVENTS if setting.quick else EVENTS
    for robots, nodes in SIZES[: 2 if setting.quick else None]:
        for capable in (SPARSE, robots) if robots else (0,):
            mission = repair()
            if robots:
                mission = large_mission(robots, nodes, capable, setting.seed)
            for is_at_work in (True, False):
                times = measure(mission, events, setting.seed, is_at_work)
                rows.append(_row(mission, capable, is_at_work, times))
        setting.say(f"  {len(mission.robots)} robots, {len(mission.tree.nodes)} nodes")
    return Result(
        REFERENCE,
        rows,
        [_table(rows)],
        notes=[
            "Medians, of pruning, evaluating, checking consistency, assigning and explaining. A "
            "robot dies, succeeds or goes on, or a condition turns; tasks by coalitions, of the "
            "repair, are passed over. Every job of the other missions has a local task of its own. "
            "Every plan was compared with the one for which nothing was kept, byte for byte."
        ],
    )


def repair() -> Mission:
    return load_mission(REPAIR)


def _row(mission: Mission, capable: int, is_at_work: bool, times: Times) -> dict[str, Any]:
    ratios = [n / s for n, s in zip(times.next_s, times.plain_s, strict=True)]
    return {
        "robots": len(mission.robots),
        "nodes": len(mission.tree.nodes),
        "capable": capable,
        "is_at_work": is_at_work,
        "events": len(ratios),
        "next_ms": statistics.median(times.next_s) * 1e3,
        "next_max_ms": max(times.next_s) * 1e3,
        "plain_ms": statistics.median(times.plain_s) * 1e3,
        "ratio": statistics.median(ratios),
    }


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    head = ("robots", "nodes", "can do a job", "team", "plan, ms", "worst, ms", "nothing kept, ms")
    shown = [
        (
            f"{row['robots']:,}",
            f"{row['nodes']:,}",
            f"{row['capable']:,}" if row["capable"] else "",
            "at work" if row["is_at_work"] else "nobody has started",
            f"{row['next_ms']:.2f}",
            f"{row['next_max_ms']:.2f}",
            f"{row['plain_ms']:.2f}",
        )
        for row in rows
    ]
    return Table(
        "The plan after one event",
        (*head, "ratio"),
        [(*cells, f"{row['ratio']:.2f}") for cells, row in zip(shown, rows, strict=True)],
    )


BENCHMARK = Benchmark("the whole plan after one event", run)
