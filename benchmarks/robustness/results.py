"""One draw judged by everybody, and the table of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from benchmarks.robustness.bounds import BestPolicy, allows
from benchmarks.robustness.draws import Cell, draw
from benchmarks.robustness.teams import independent_robots, our_team

HEAD = ("robots", "h", "FP", "MRBTP, published", "independent", "ours", "best policy", "bound")


@dataclass(frozen=True)
class Judged:
    """What became of one draw: of our team, of independent robots; what was possible.

    `best`: what the best policy made of it; `chance` is that policy's probability of success.
    """

    ours: bool
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
        "ours": rate([each.ours for each in judged]),
        "best_policy": rate([each.best for each in judged]),
        "best_policy_expected": rate([each.chance for each in judged]),
        "bound": rate([each.allowed for each in judged]),
        "allowed_but_failed": sum(each.allowed and not each.ours for each in judged),
        "succeeded_but_not_allowed": sum(
            each.ours > each.allowed or each.independent > each.allowed for each in judged
        ),
    }


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """The table for people, success rates in percent."""
    lines = [HEAD, ("---",) * len(HEAD)]
    for row in rows:
        rates = [row[key] for key in ("published", "independent", "ours", "best_policy", "bound")]
        setting = (row["robots"], f"{row['homogeneity']:g}", f"{row['fault_probability']:g}")
        lines.append((*map(str, setting), *(f"{rate:.1f}" for rate in rates)))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
