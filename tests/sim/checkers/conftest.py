"""The team that tests of checkers break something in."""

from __future__ import annotations

import pytest

from mrbt_mesh.sim import Kill
from tests.support.checked_team import SECOND_US, Team
from tests.support.runs import Run


@pytest.fixture
def team(run: Run) -> Team:
    """Five robots that rest: the screws are out, and the cover waits for C1, which is dead."""
    kill = [(SECOND_US, Kill("C1"))]
    result = run("vehicle_repair", 1, schedule=kill, expect="blocked", timeout_us=9 * SECOND_US)
    return Team(agent for robot, agent in sorted(result.agents.items()) if robot != "C1")
