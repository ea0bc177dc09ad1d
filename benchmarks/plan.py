"""The whole plan after one event: against one by the definition."""

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
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.formats.mission_file import load_mission

# Robots and nodes; 0: the vehicle repair.
SIZES = ((0, 0), (50, 500), (200, 1_000), (1_000, 10_000))
EVENTS, QUICK_EVENTS = 60, 15
REFERENCE = "from scratch"


@dataclass
class Times:
    """Seconds per event: pruning and the next plan, and a plan from scratch."""

    next_s: list[float] = field(default_factory=list)
    scratch_s: list[float] = field(default_factory=list)


def measured(function: Callable[[], Plan]) -> tuple[float, Plan]:
    """(the lesser of elapsed and CPU seconds, for the machine may be shared; the plan)."""
    started_s, cpu_s = time.perf_counter(), time.process_time()
    plan = function()
    return min(time.perf_counter() - started_s, time.process_time() - cpu_s), plan


class Story:
    """Events that befall a team at work, one after the other."""

    def __init__(self, mission: Mission, seed: int) -> None:
        self.team = LargeTeam(mission)
        self.plan = self.team.plan()
        self._pick = random.Random(f"{seed}/{mission.name}")
        # Those that let a job be skipped; without the others the mission would fail.
        self._skips = sorted(name for name in mission.conditions if name.startswith("done"))
        self._settle()

    def events(self, count: int) -> Iterator[tuple[str, Callable[[], None]]]:
        """Kind of event, and what lets it happen."""
        for number in range(count):
            kinds = [("outcome", self._outcome), ("claim", self._claim), ("death", self._death)]
            if self._skips:
                kinds.append(("condition", self._condition))
            yield kinds[number % len(kinds)]

    def after(self) -> None:
        """The team goes on: whoever has died returns, and robots begin what is planned."""
        self._settle()

    def _settle(self) -> None:
        for robot in self.team.mission.robots:
            self.team.alive.setdefault(robot, Incarnation(1, "n"))
        self.plan = self.team.plan()
        self.team.start(self.plan)
        self.plan = self.team.plan()
        while self.plan.lines and not any(line.pinned for line in self.plan.lines.values()):
            # All of it are tasks by coalitions, which are passed over.
            line = next(iter(self.plan.lines.values()))
            self.team.write(line.robot, (f"{records.DONE}/{line.activation}", True))
            self.plan = self.team.plan()
            self.team.start(self.plan)
            self.plan = self.team.plan()

    def _busy(self) -> str:
        return self._pick.choice(sorted(r for r, x in self.plan.lines.items() if x.pinned))

    def _outcome(self) -> None:
        self.team.finish(self.plan, self._busy())

    def _claim(self) -> None:
        robot = self._busy()
        self.team.begin(self.plan.lines[robot])

    def _death(self) -> None:
        del self.team.alive[self._busy()]

    def _condition(self) -> None:
        name = self._pick.choice(self._skips)
        self.team.turn(name, not self.team.facts.condition(name), self._busy())


def measure(mission: Mission, events: int, seed: int) -> dict[str, Times]:
    """Times per kind of event. Raises AssertionError if the two plans ever differ."""
    story, found = Story(mission, seed), dict[str, Times]()
    for kind, happen in story.events(events):
        if not any(line.pinned for line in story.plan.lines.values()):
            break  # the mission is over
        happen()
        times = found.setdefault(kind, Times())
        next_s, plan = measured(story.team.plan)
        scratch_s, fresh = measured(story.team.plan_anew)
        assert plan.packed == fresh.packed, f"{mission.name}: seed {seed}, {kind}"
        times.next_s.append(next_s)
        times.scratch_s.append(scratch_s)
        story.after()
    return found


def run(setting: Setting) -> Result:
    rows: list[dict[str, Any]] = []
    for robots, nodes in SIZES[: 3 if setting.quick else None]:
        mission = large_mission(robots, nodes, seed=setting.seed) if robots else repair()
        events = QUICK_EVENTS if setting.quick else EVENTS
        for kind, times in measure(mission, events, setting.seed).items():
            rows.append(_row(mission, kind, times))
        setting.say(f"  {len(mission.robots)} robots, {len(mission.tree.nodes)} nodes")
    return Result(
        REFERENCE,
        rows,
        [_table(rows)],
        notes=[
            "Medians, of pruning, evaluating, checking consistency, assigning and explaining. All "
            "robots are at work. Jobs have local tasks of their own that 10 robots can do. An "
            "outcome is that of one robot, a condition turns for one job, and a claim is of one "
            "robot that goes on; tasks by coalitions, of the repair, are passed over. Every plan "
            "was compared with the one from scratch, byte for byte."
        ],
    )


def repair() -> Mission:
    return load_mission(REPAIR)


def _row(mission: Mission, kind: str, times: Times) -> dict[str, Any]:
    ratios = [n / s for n, s in zip(times.next_s, times.scratch_s, strict=True)]
    return {
        "robots": len(mission.robots),
        "nodes": len(mission.tree.nodes),
        "event": kind,
        "events": len(ratios),
        "next_ms": statistics.median(times.next_s) * 1e3,
        "next_max_ms": max(times.next_s) * 1e3,
        "scratch_ms": statistics.median(times.scratch_s) * 1e3,
        "ratio": statistics.median(ratios),
    }


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    head = ("robots", "nodes", "event", "next, ms", "worst, ms", "from scratch, ms", "ratio")
    shown = [
        (
            str(row["robots"]),
            f"{row['nodes']:,}",
            row["event"],
            f"{row['next_ms']:.2f}",
            f"{row['next_max_ms']:.2f}",
            f"{row['scratch_ms']:.2f}",
            f"{row['ratio']:.2f}",
        )
        for row in rows
    ]
    return Table("The plan after one event", head, shown)


BENCHMARK = Benchmark("the whole plan after one event", run)
