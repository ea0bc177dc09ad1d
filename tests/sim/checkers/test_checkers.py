"""The checkers see what they are there for: each is shown a team that breaks its invariant."""

from __future__ import annotations

from tests.support.checked_team import Team


def test_a_team_at_rest_breaks_nothing(team: Team) -> None:
    assert team.sample() == []
    assert {"I1", "I2", "I3", "I4"} <= team.checkers.checks.keys()
