"""One draw judged by everybody, and the table of all of them."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from benchmarks.report import grid
from benchmarks.robustness.bounds import BestPolicy, allows
from benchmarks.robustness.draws import Cell, draw
from benchmarks.robustness.teams import independent_robots, our_team

# Column -> what it is called for people; success rates in percent.
RATES = {
    "published": "MRBTP, published",
    "independent": "independent",
    "ours": "ours",
    "best_policy": "best policy",
    "bound": "bound",
}
HEAD = ("robots", "h", "FP", *RATES.values())


@dataclass(frozen=True)
class Judged:
    """What became of one draw: of our team, of independent robots; what was possible.

    `ours`: (success, seconds). `best`: what the best policy made of it; `chance` is that
    policy's probability of success.
    """

    ours: tuple[bool, float]
    independent: bool
    allowed: bool
    best: bool
    chance: float


@lru_cache(maxsize=8)
def _policy(able: tuple[frozenset[int], ...], robots: int, fault: int) -> BestPolicy:
    return BestPolicy(able, robots, fault)


def judge(cell: Cell, seeds: Sequence[int]) -> list[Judged]:
    """Run some draws of a cell."""
    found = []
    for seed in seeds:
        luck = draw(cell, seed)
        policy = _policy(luck.able, cell.robots, cell.fault)
        found.append(
            Judged(
                our_team(luck),
                independent_robots(luck),
                allows(luck),
                policy.succeeds(luck),
                policy.chance,
            )
        )
    return found


def summary(cell: Cell, judged: Sequence[Judged]) -> dict[str, Any]:
    """A row of the table; rates in percent."""

    def rate(values: list[bool] | list[float]) -> float:
        return round(100 * sum(values) / len(judged), 1)

    return {
        "robots": cell.robots,
        "homogeneity": cell.homogeneity / 100,
        "fault_probability": cell.fault / 100,
        "runs": len(judged),
        "published": cell.published,
        "independent": rate([each.independent for each in judged]),
        "ours": rate([each.ours[0] for each in judged]),
        "best_policy": rate([each.best for each in judged]),
        "best_policy_expected": rate([each.chance for each in judged]),
        "bound": rate([each.allowed for each in judged]),
        "allowed_but_failed": sum(each.allowed > each.ours[0] for each in judged),
        "succeeded_but_not_allowed": sum(
            max(each.independent, each.best, each.ours[0]) > each.allowed for each in judged
        ),
        "median_success_s": _median_s(judged),
    }


def _median_s(judged: Sequence[Judged]) -> float | None:
    times_s = [seconds for done, seconds in (each.ours for each in judged) if done]
    return round(statistics.median(times_s), 2) if times_s else None


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """The table for people, success rates in percent."""
    shown = []
    for row in rows:
        rates = [row[key] for key in RATES]
        setting = (row["robots"], f"{row['homogeneity']:g}", f"{row['fault_probability']:g}")
        shown.append((*setting, *(f"{rate:.1f}" for rate in rates)))
    return grid(HEAD, shown)
