"""A team at rest, as checkers see it, for tests that break something in it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.inputs import Input, TimerFired
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.sim import NetworkKnobs
from mrbt_mesh.sim.checkers.checkers import Checkers
from mrbt_mesh.sim.world.clock import VirtualClock
from mrbt_mesh.sim.world.network import Network

SECOND_US = 1_000_000


class Process:
    """The part of a SimProcess that checkers look at."""

    is_over = is_slow = False
    runs = has_read_journal = True

    def __init__(self, agent: Agent, clock: VirtualClock) -> None:
        self.robot = agent.view.robot
        self.agent = agent
        self._clock = clock

    def deliver(self, event: Input) -> None:
        self.agent.handle(event, self._clock.now_us)


class Team:
    """Agents, long after the last change, as the checkers see a world."""

    cut_off = False
    plan_delay_us = 0
    healed_us = None
    speed = 1.0

    def __init__(self, agents: Iterable[Agent]) -> None:
        self.clock = VirtualClock()
        self.clock.now_us = 100 * SECOND_US
        self.network = Network(NetworkKnobs(), 1)
        self.timing = Timing()
        self.solver: Any = min_cost_flow
        self.processes = [Process(agent, self.clock) for agent in agents]
        self.agents = [process.agent for process in self.processes]
        self.views = [agent.view for agent in self.agents]
        self.mission = self.agents[0].view.mission
        self.checkers = Checkers(self)  # type: ignore[arg-type]

    def living(self) -> list[Any]:
        return list(self.processes)

    def sample(self) -> list[str]:
        """What is found now."""
        self.checkers.violations.clear()
        self.checkers.sample()
        return [text.partition(" at ")[0] for text in self.checkers.violations]


def start(team: Team, robot: str, global_task: str, local_task: str) -> list[str]:
    process = next(process for process in team.processes if process.robot == robot)
    node = next(node for node in team.mission.tree.actions() if node.subject == global_task)
    activation = str(
        process.agent.view.mission.evaluator.current_activation(
            node.index, process.agent.view.facts
        )
    )
    incarnation = process.agent.view.incarnation
    effect = StartAction(9, activation, global_task, local_task, (), 1, incarnation)
    team.checkers.handled(process, TimerFired(), [effect])  # type: ignore[arg-type]
    return [text.partition(" at ")[0] for text in team.checkers.violations]
