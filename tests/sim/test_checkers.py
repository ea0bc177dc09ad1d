"""The checkers see what they are there for: each one is shown a team that breaks its invariant."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from runs import Run, example

from mrbt_mesh.core.agent import Agent
from mrbt_mesh.core.effects import CapabilityChanged, Input, StartAction, TimerFired
from mrbt_mesh.core.records import OUTCOME, Claim, Phase
from mrbt_mesh.core.solvers import min_cost_flow
from mrbt_mesh.core.timing import Timing
from mrbt_mesh.core.work import Ticket
from mrbt_mesh.sim import Kill, NetworkKnobs, simulate
from mrbt_mesh.sim.checkers import Checkers
from mrbt_mesh.sim.clock import VirtualClock
from mrbt_mesh.sim.network import Network

SECOND_US = 1_000_000


class Process:
    """The part of a SimProcess that checkers look at."""

    is_over = is_slow = False
    runs = True

    def __init__(self, agent: Agent, clock: VirtualClock) -> None:
        self.robot = agent.me
        self.agent = agent
        self._clock = clock

    def deliver(self, event: Input) -> None:
        self.agent.handle(event, self._clock.now_us)


class Team:
    """Agents, long after the last change, as the checkers see a world."""

    cut_off = False
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
        self.mission = self.agents[0].mission
        self.checkers = Checkers(self)  # type: ignore[arg-type]

    def living(self) -> list[Any]:
        return list(self.processes)

    def sample(self) -> list[str]:
        """What is found now."""
        self.checkers.violations.clear()
        self.checkers.sample()
        return [text.partition(" at ")[0] for text in self.checkers.violations]


@pytest.fixture
def team(run: Run) -> Team:
    """Five robots that rest: the screws are out, and the cover waits for C1, which is dead."""
    kill = [(SECOND_US, Kill("C1"))]
    result = run("vehicle_repair", 1, schedule=kill, expect="blocked", timeout_us=9 * SECOND_US)
    return Team(agent for robot, agent in sorted(result.agents.items()) if robot != "C1")


def test_a_team_at_rest_breaks_nothing(team: Team) -> None:
    assert team.sample() == []
    assert {"I1", "I2", "I3", "I4"} <= team.checkers.checks.keys()


def test_i1_plans_that_differ_on_the_same_facts(team: Team) -> None:
    facts = team.agents[0].facts
    facts.run = "another"
    facts.changes += 1
    assert "I1" in team.sample()


def test_i2_facts_that_stay_different(team: Team) -> None:
    facts = team.agents[0].facts.map
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    facts.drop(entry.author, entry.name)
    assert "I2" in team.sample()
    assert "differ" in team.checkers.violations[0]


def test_i2_waits_until_the_network_is_quiet(team: Team) -> None:
    facts = team.agents[0].facts.map
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    facts.drop(entry.author, entry.name)
    team.checkers.findings.changed_us = team.clock.now_us - SECOND_US
    assert team.sample() == []


def test_i2_views_of_the_living_that_stay_different(team: Team) -> None:
    del team.agents[0].membership.peers["B1"]
    assert "I2" in team.sample()
    assert "alive" in team.checkers.violations[0]


def test_i3_an_outcome_that_is_lost_and_a_task_that_is_undone(team: Team) -> None:
    assert team.sample() == []
    facts = team.agents[0].facts.map
    for entry in [entry for entry in facts if entry.name.startswith(OUTCOME)]:
        facts.drop(entry.author, entry.name)
    assert "I3" in team.sample()
    lost = [text for text in team.checkers.violations if text.startswith("I3")]
    assert any("has lost" in text for text in lost)
    assert any("is not finished any more" in text for text in lost)


def start(team: Team, robot: str, global_task: str, local_task: str) -> list[str]:
    process = next(process for process in team.processes if process.robot == robot)
    node = next(node for node in team.mission.tree.actions() if node.subject == global_task)
    activation = str(process.agent.planner.evaluator.current_scope(node.index, process.agent.facts))
    incarnation = process.agent.incarnation
    effect = StartAction(9, activation, global_task, local_task, (), 1, incarnation)
    team.checkers.handled(process, TimerFired(), [effect])  # type: ignore[arg-type]
    return [text.partition(" at ")[0] for text in team.checkers.violations]


def test_i3_work_that_is_started_although_it_is_done(team: Team) -> None:
    assert start(team, "C2", "remove_screws", "use_screwdriver") == ["I3"]


def test_i4_work_that_a_robot_cannot_do(team: Team) -> None:
    assert start(team, "A1", "remove_cover", "move_frame") == ["I4"]


def test_i4_more_robots_at_once_than_are_allowed(team: Team) -> None:
    activation = f"{team.agents[0].facts.run}:4:remove_cover::0"
    for agent in team.agents[:3]:
        agent.work.action = Ticket(1, activation, "remove_cover", "move_frame")
    assert start(team, "C2", "remove_cover", "move_frame") == ["I4"]
    assert "A1, A2, B1 are on move_frame" in team.checkers.violations[0]
    team.cut_off = True
    team.checkers.violations.clear()
    assert start(team, "C2", "remove_cover", "move_frame") == []


def test_i4_work_that_is_not_in_the_plan(team: Team) -> None:
    activation = f"{team.agents[0].facts.run}:4:remove_cover::0"
    claim = Claim(activation, "remove_cover", "move_frame", Phase.RUNNING, 1)
    team.agents[-1].work.claim = claim
    assert team.agents[-1].me == "C2"
    assert team.sample() == ["I4"]


def test_i4_bounds_that_are_not_met(run: Run) -> None:
    """Two robots that could explore, and a solver that finds nothing for them to do."""
    mission, program = example("explore")
    result = simulate(mission, program, seed=1, timeout_us=2 * SECOND_US)
    team = Team(agent for _, agent in sorted(result.agents.items()))
    team.solver = lambda problem: None
    for agent in team.agents:
        agent.facts.claims.clear()
        agent.facts.changes += 1
        agent.work.claim = None
    assert "I4" in team.sample()
    assert any(
        "0 robots on explore" in text and text.endswith(": 1..1")
        for text in team.checkers.violations
    )


def test_i6_a_mission_that_is_not_finished_in_time() -> None:
    mission, program = example("explore")
    result = simulate(mission, program, seed=1, timeout_us=2 * SECOND_US)
    assert result.result == "timeout"
    assert [text[:2] for text in result.violations] == ["I6"]


def test_i6_robots_that_do_not_stop(team: Team) -> None:
    team.checkers.i6.never_stopped()
    assert "A1, A2, B1, B2, C2 did not stop" in team.checkers.violations[0]


def test_i8_input_that_leaves_a_trace(team: Team) -> None:
    team.clock.now_us = 9 * SECOND_US + 1
    process: Any = team.processes[0]
    team.checkers.i8.arrives(process, TimerFired())
    assert team.checkers.violations == []
    team.checkers.i8.arrives(process, CapabilityChanged("replace_hw", lost=True))
    assert team.checkers.violations[0].startswith("I8")
