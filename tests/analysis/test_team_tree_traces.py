"""A team of one robot against traces of the real BehaviorTree.CPP 4.10."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.support.btcpp.conformance import Trace, team_run, team_tree, traces

# How many traces of each family a team can carry out, and how many of them it tells otherwise.
COMPARABLE = {"tame": (928, 8), "mid": (655, 5), "free": (676, 66)}


def differs(trace: Trace) -> bool | None:
    """Whether the team tells it otherwise; None: it cannot carry it out, or the library failed."""
    team = team_tree(trace)
    if team.spec is None or trace.error:
        return None
    found = team_run(team.spec, trace)
    if found != trace.shown:
        assert team.notes, (
            f"{trace.id} differs without a note:\n{trace.xml}\n{found}\n{trace.shown}"
        )
    return found != trace.shown


@pytest.mark.slow
@pytest.mark.parametrize("family", COMPARABLE)
def test_a_team_of_one_does_what_the_library_does_or_says_what_differs(family: str) -> None:
    counts = Counter(differs(trace) for trace in traces() if trace.family == family)
    assert (counts[True] + counts[False], counts[True]) == COMPARABLE[family]
