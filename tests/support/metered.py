"""A team in memory, one robot of which is metered as its driver would do it."""

from __future__ import annotations

from unittest.mock import patch

from mrbt_mesh.adapters.metrics.families import Distribution, Family
from mrbt_mesh.adapters.metrics.meter import Meter
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.observer import Observer
from tests.support import harness
from tests.support.script import Script
from tests.support.watched import COVER


class MeteredAgent(Agent):
    """An agent with its meter."""

    def __init__(self, mission: Mission, config: AgentConfig, now_us: int) -> None:
        super().__init__(mission, config, now_us)
        self.meter = Meter(config.robot, mission)

    def handle(self, event: Input, now_us: int) -> list[Effect]:
        self.meter.take(event)
        effects = super().handle(event, now_us)
        for effect in effects:
            self.meter.carry_out(effect)
        return effects


class MeteredTeam:
    """The script of a team, with the meter of `A` and the observer."""

    def __init__(self, *commands: str) -> None:
        self.script = Script()
        with patch.object(harness, "Agent", MeteredAgent):
            self.script.block(COVER[:-1])
        agent = self.script.team.processes["A"].agent
        assert isinstance(agent, MeteredAgent)
        self.view, self.meter = agent.view, agent.meter
        self.script.block(["pass 200", *commands])

    @property
    def observer(self) -> Observer:
        assert self.script.team.observer is not None
        return self.script.team.observer


def values(families: list[Family]) -> dict[tuple[str, ...], float]:
    """(name, labels...) -> value; of a distribution how many there were."""
    return {
        (family.name, *labels): float(sum(value.counts))
        if isinstance(value, Distribution)
        else value
        for family in families
        for labels, value in family.samples
    }
