"""The fewest faults that make one service infeasible, worked out without a solver.

By Hall's theorem some set of its needs must end up with fewer able robots than it asks for, so for
every set the robots that are cheapest to take from it are counted. What it costs to take a robot
from a set of needs is 1 for its death, else the capabilities that it must lose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from mrbt_mesh.analysis.tolerance.service import (
    Capability,
    Fault,
    FaultyTeam,
    JointNeed,
    Service,
    merged,
)
from mrbt_mesh.core.facts.coalitions import majority

MAX_NEEDS = 8


@dataclass(frozen=True)
class Breaking:
    """It takes at least `least` faults, and `chosen` do it."""

    least: int
    chosen: tuple[Fault, ...]


def fewest_to_break(team: FaultyTeam, wanted: Service, is_major: bool) -> Breaking:
    """The fewest faults of one kind that make a feasible service infeasible.

    With more than `MAX_NEEDS` different needs `chosen` may be more than `least`.
    """
    needs = merged(wanted.needs, is_major)
    choices = []
    if len(needs) > MAX_NEEDS:
        _, tight = team.tightest(needs)
        choices.append(_cheapest([needs[index] for index in tight], is_major))
    else:
        for size in range(1, len(needs) + 1):
            for subset in combinations(needs, size):
                choices.append(_cheapest(subset, is_major))
    if wanted.exclusive and is_major:
        robots = sorted(team.mission.robots)
        choices.append(tuple(robots[: len(robots) - majority(robots) + 1]))
    best = min(choices, key=len)
    if len(needs) > MAX_NEEDS:
        # No fault takes more than one robot from a set of needs.
        return Breaking(team.slack(wanted) + 1, best)
    return Breaking(len(best), best)


def _cheapest(subset: Sequence[JointNeed], is_major: bool) -> tuple[Fault, ...]:
    """The fewest faults after which these needs find one robot too few."""
    able = sorted({robot for need in subset for robot in need.entries})
    too_many = len(able) - sum(need.count for need in subset) + 1
    if is_major:
        return tuple(able[:too_many])
    costs = sorted(
        (
            removal(tuple(need.entries[robot] for need in subset if robot in need.entries))
            for robot in able
        ),
        key=lambda entries: (len(entries), entries),
    )
    return tuple(entry for entries in costs[:too_many] for entry in entries)


def removal(ways: tuple[tuple[Capability, ...], ...]) -> tuple[Capability, ...]:
    """The fewest capabilities that hit every one of these ways."""
    forced = {way[0] for way in ways if len(way) == 1}
    open_ways = {way for way in ways if forced.isdisjoint(way)}
    entries = sorted({entry for way in open_ways for entry in way})
    for size in range(len(entries) + 1):
        for extra in combinations(entries, size):
            if all(not set(extra).isdisjoint(way) for way in open_ways):
                return tuple(sorted({*forced, *extra}))
    raise AssertionError("all entries together hit every way")
