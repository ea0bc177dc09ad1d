"""Replicas of a small mission's facts, without agents."""

from __future__ import annotations

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.replica import Replica
from mrbt_mesh.core.membership.wire import Header
from tests.support.build import RUN, action, condition, make_mission, sequence
from tests.support.harness import TIMING

MISSION = make_mission(sequence(condition("c"), action("a")))


def replica(robot: str, nonce: str = "n") -> Replica:
    """The empty replica of a robot."""
    header = Header(MISSION.digest[:16], MISSION.name, RUN, robot)
    return Replica(TeamFacts(MISSION, RUN), header, TIMING, nonce)
