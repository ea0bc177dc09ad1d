"""Who hears a robot's heartbeats in a team in which not all are neighbours."""

from __future__ import annotations

from unittest import mock

import pytest

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.effects import Publish
from mrbt_mesh.core.membership.dissemination import Urgent
from mrbt_mesh.core.membership.ring import Ring
from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from tests.support.patrols import MS, started

ROBOTS = 16
TIMING = Timing().of_team(ROBOTS)


class Speaker:
    """One robot of a team at rest, and what it has to say urgently."""

    def __init__(self) -> None:
        team = started(ROBOTS)
        agent = next(iter(team._world.robots.processes.values())).agent
        assert agent is not None
        self.agent: Agent = agent
        self.heartbeats = self.agent._heartbeats
        self.urgent: Urgent = self.heartbeats._urgent(self.agent.view.plan)
        self.now_us = team.now_us + 10 * SECOND_US
        self.neighbours = set(Ring(team.mission.robots, TIMING.reach).neighbours(self.robot))
        self.agent._context.take_effects()

    @property
    def robot(self) -> str:
        return self.agent.view.robot

    def says(self, after_us: int, **changes: object) -> tuple[str, ...] | str | None:
        """Who hears it when this changes after some time; `nothing` if it says nothing."""
        self.now_us += after_us
        self.urgent = self.urgent._replace(**changes)
        with mock.patch.object(self.heartbeats, "_urgent", return_value=self.urgent):
            self.heartbeats.send_if_due(self.agent.view.plan, self.now_us)
        sent = [each for each in self.agent._context.take_effects() if isinstance(each, Publish)]
        return sent[0].to if sent else "nothing"


@pytest.fixture
def speaker() -> Speaker:
    found = Speaker()
    found.says(0)  # the regular one, which is due
    return found


def test_of_a_plan_neighbours_hear_by_the_first_repetition(speaker: Speaker) -> None:
    first = speaker.says(100 * MS, digest=b"another ")
    assert isinstance(first, tuple)
    assert len(first) <= 2, "representatives only"
    second = speaker.says(TIMING.repeat_offsets_us()[0])
    assert isinstance(second, tuple)
    assert speaker.neighbours <= set(second)
    third = speaker.says(TIMING.repeat_offsets_us()[1] - TIMING.repeat_offsets_us()[0])
    assert isinstance(third, tuple)
    assert not speaker.neighbours <= set(third)


def test_what_everybody_is_to_hear_is_not_told_to_some_because_a_plan_changes_too(
    speaker: Speaker,
) -> None:
    broadcast = speaker.urgent.broadcast
    assert speaker.says(100 * MS, broadcast=broadcast + 1) is None
    # At most once per period: neighbours hear of it now, all others as soon as that is over.
    assert isinstance(speaker.says(50 * MS, broadcast=broadcast + 2), tuple)
    assert speaker.says(TIMING.heartbeat_us - 20 * MS, digest=b"another ") is None
