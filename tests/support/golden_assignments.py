"""Problems that are the same everywhere, and the digests of their answers in a file.

    python -m tests.support.golden_assignments

writes the file anew.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.problem import (
    AssignmentProblem,
    Bounds,
    Limit,
    Shared,
    SideConstraint,
)
from mrbt_mesh.core.assignment.solvers import default_solver

FILE = Path(__file__).with_suffix(".json")
# robots, demands, how many cases, whether with side constraints
SIZES = (
    (5, 3, 200, False),
    (12, 6, 100, False),
    (40, 20, 60, False),
    (150, 60, 20, False),
    (5, 3, 80, True),
    (10, 5, 30, True),
    (24, 8, 10, True),
)


class Draw:
    """Numbers from a hash: the same in every version of everything."""

    def __init__(self, seed: str) -> None:
        self._seed = seed
        self._count = 0

    def below(self, limit: int) -> int:
        self._count += 1
        text = f"{self._seed}/{self._count}".encode()
        return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "big") % limit


def case(robots: int, demands: int, number: int, limited: bool) -> AssignmentProblem:
    """A problem with many ties; most have an answer."""
    draw = Draw(f"{robots}x{demands}/{limited}/{number}")
    density = (30, 60, 100)[draw.below(3)]
    kinds = (1, 2, 5)[draw.below(3)]
    bounds = []
    for index in range(demands):
        lower = draw.below(3) // 2 + draw.below(2)
        bounds.append(Bounds(f"d{index}", lower, lower + draw.below(3)))
    rows = [
        {d: (1 + draw.below(kinds)) * 500_000 for d in range(demands) if draw.below(100) < density}
        for _ in range(robots)
    ]
    limits: list[SideConstraint] = []
    for _ in range(1 + draw.below(3) if limited else 0):
        who = tuple(r for r in range(robots) if draw.below(3) == 0)
        what = tuple(d for d in range(demands) if draw.below(2) == 0)
        limits.append(Limit(who, what, max(1, len(who) // 2)))
        limits.append(Shared(tuple((d,) for d in what), max(1, len(what) - 1)))
    names = [f"r{index:03}" for index in range(robots)]
    return AssignmentProblem.of(names, bounds, rows, limits)


def digests(robots: int, demands: int, count: int, limited: bool) -> dict[str, object]:
    """Of the problems and of the answers: if the problems are equal, a solver is at fault."""
    problems, answers, feasible = hashlib.sha256(), hashlib.sha256(), 0
    for number in range(count):
        given = case(robots, demands, number, limited)
        problems.update(repr((given.demands, given.performance, given.constraints)).encode())
        answer = solve(given, default_solver)
        feasible += answer is not None
        answers.update(json.dumps(answer).encode())
    return {
        "problems": problems.hexdigest(),
        "answers": answers.hexdigest(),
        "feasible": feasible,
    }


def name(size: tuple[int, int, int, bool]) -> str:
    robots, demands, count, limited = size
    return f"{count} of {robots}x{demands}{', side constraints' if limited else ''}"


def _written() -> Iterator[tuple[str, dict[str, object]]]:
    for size in SIZES:
        yield name(size), digests(*size)


if __name__ == "__main__":
    FILE.write_text(json.dumps(dict(_written()), indent=2) + "\n")
    sys.stdout.write(f"written: {FILE}\n")
