"""The checkers see what they are there for: each one is shown a team that breaks its invariant."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Iterable
from typing import Any

import pytest

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.effects import CancelAction, Forget, Log, Persist, Publish, StartAction
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    ActionStopped,
    CapabilityChanged,
    Input,
    TimerFired,
)
from mrbt_mesh.core.agent.work import Ticket
from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.problem import AssignmentProblem, Bounds, SolverError
from mrbt_mesh.core.assignment.solvers import brute_force, min_cost_flow
from mrbt_mesh.core.facts.records import BROKEN, GRANT, OUTCOME, Claim, OrderKind, Phase
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.membership.joining import Joining
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.mission import InDoubtPolicy
from mrbt_mesh.sim import Kill, NetworkKnobs, simulate
from mrbt_mesh.sim.checkers.checkers import Checkers
from mrbt_mesh.sim.checkers.findings import is_connected
from mrbt_mesh.sim.engine.clock import VirtualClock
from mrbt_mesh.sim.engine.network import Network
from tests.support import inside
from tests.support.mutations import MUTATIONS
from tests.support.runs import Run, example

SECOND_US = 1_000_000


class Process:
    """The part of a SimProcess that checkers look at."""

    is_over = is_slow = False
    runs = True

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
    facts = team.agents[0].view.facts
    facts.run = "another"
    facts.changes += 1
    inside.planner(team.agents[0])._evaluator.forget()
    assert "I1" in team.sample()


def test_i2_facts_that_stay_different(team: Team) -> None:
    facts = team.agents[0].view.facts.map
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    facts.drop(entry.author, entry.name)
    assert "I2" in team.sample()
    assert "differ" in team.checkers.violations[0]


def test_i2_waits_until_the_network_is_quiet(team: Team) -> None:
    facts = team.agents[0].view.facts.map
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    facts.drop(entry.author, entry.name)
    team.checkers.findings.changed_us = team.clock.now_us - SECOND_US
    assert team.sample() == []


def test_i2_views_of_the_living_that_stay_different(team: Team) -> None:
    del team.agents[0].view.peers["B1"]
    assert "I2" in team.sample()
    assert "alive" in team.checkers.violations[0]


def test_i2_nobody_is_held_for_dead_who_is_heard(team: Team) -> None:
    process: Any = team.processes[0]

    def declared_dead(robot: str) -> list[str]:
        team.checkers.violations.clear()
        log = Log("warning", "robot_dead", {"robot": robot})
        team.checkers.handling(process, TimerFired())
        team.checkers.handled(process, TimerFired(), [log])
        return [text.partition(": ")[2] for text in team.checkers.violations]

    text = "A1 holds B1 for dead, which"
    others = [f"{text} {other} hears" for other in ("A2", "B2", "C2")]
    assert declared_dead("B1") == [f"{text} it hears", *others]
    assert declared_dead("C1") == []
    team.network.blocked = {("B1", "A1"), ("B1", "A2"), ("B2", "A1")}
    assert declared_dead("B1") == [f"{text} C2 hears"]
    # A link that has just come back, or a fault of another kind: give it time.
    team.checkers.findings.fault_came([("B1", "C2")])
    assert declared_dead("B1") == []
    team.network.blocked = set()
    team.checkers.findings.fault_came()
    assert declared_dead("B1") == []


def test_i3_an_outcome_that_is_lost_and_a_task_that_is_undone(team: Team) -> None:
    assert team.sample() == []
    facts = team.agents[0].view.facts.map
    for entry in [entry for entry in facts if entry.name.startswith(OUTCOME)]:
        facts.drop(entry.author, entry.name)
    assert "I3" in team.sample()
    lost = [text for text in team.checkers.violations if text.startswith("I3")]
    assert any("has lost" in text for text in lost)
    assert any("is not finished any more" in text for text in lost)


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


def test_i3_work_that_is_started_although_it_is_done(team: Team) -> None:
    assert start(team, "C2", "remove_screws", "use_screwdriver") == ["I3"]


def test_i4_work_that_a_robot_cannot_do(team: Team) -> None:
    assert start(team, "A1", "remove_cover", "move_frame") == ["I4"]


def test_i4_more_robots_at_once_than_are_allowed(team: Team) -> None:
    activation = f"{team.agents[0].view.facts.run}:4:remove_cover::0"
    for agent in team.agents[:3]:
        inside.context(agent).work.action = Ticket(1, activation, "remove_cover", "move_frame")
    assert start(team, "C2", "remove_cover", "move_frame") == ["I4"]
    assert "A1, A2, B1 are on move_frame" in team.checkers.violations[0]
    team.cut_off = True
    team.checkers.violations.clear()
    assert start(team, "C2", "remove_cover", "move_frame") == []


def test_i4_work_that_is_not_in_the_plan(team: Team) -> None:
    activation = f"{team.agents[0].view.facts.run}:4:remove_cover::0"
    claim = Claim(activation, "remove_cover", "move_frame", Phase.RUNNING, 1)
    inside.context(team.agents[-1]).work.claim = claim
    assert team.agents[-1].view.robot == "C2"
    assert team.sample() == ["I4"]


def test_i4_bounds_that_are_not_met(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two robots that could explore, and *Assign Agents* finds nothing for them to do."""
    mission, program = example("explore")
    result = simulate(mission, program, seed=1, timeout_us=2 * SECOND_US)
    team = Team(agent for _, agent in sorted(result.agents.items()))
    monkeypatch.setattr("mrbt_mesh.core.planning.steps.optimum", lambda team, solver: None)
    for agent in team.agents:
        agent.view.facts.claims.clear()
        agent.view.facts.changes += 1
        inside.context(agent).work.claim = None
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


def test_i6_a_robot_that_does_not_join(team: Team) -> None:
    team.healed_us = 0
    agent = team.agents[0]
    inside.context(agent).joining = Joining(team.timing, frozenset(), team.clock.now_us)
    team.checkers.findings.fault_came()
    team.checkers.i6.sample()
    assert team.checkers.violations == []
    team.clock.now_us += 30 * SECOND_US
    team.checkers.i6.sample()
    assert "A1 did not join within 30.0 s" in team.checkers.violations[0]


def test_liveness_is_demanded_of_a_team_with_a_broken_link_but_not_of_parts(team: Team) -> None:
    both = {("A1", "C2"), ("C2", "A1")}
    assert is_connected(team.views, set())
    assert is_connected(team.views, {("A1", "C2")})
    assert is_connected(team.views, both)
    deaf = {(agent.view.robot, "C2") for agent in team.agents if agent.view.robot != "C2"}
    assert not is_connected(team.views, deaf)
    assert not is_connected(team.views, deaf | {(target, source) for source, target in deaf})


def test_i8_input_that_leaves_a_trace(team: Team) -> None:
    team.clock.now_us = 9 * SECOND_US + 1
    process: Any = team.processes[0]
    team.checkers.i8.arrives(process, TimerFired())
    assert team.checkers.violations == []
    team.checkers.i8.arrives(process, CapabilityChanged("replace_hw", lost=True))
    assert team.checkers.violations[0].startswith("I8")


def test_i2_what_somebody_held_long_ago_and_another_still_lacks(team: Team) -> None:
    """Also where new facts keep coming, so that the digests never have to be equal."""
    facts = team.agents[0].view.facts.map
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    facts.drop(entry.author, entry.name)
    for _ in range(40):
        team.clock.now_us += SECOND_US // 5
        team.checkers.findings.changed_us = team.clock.now_us
        team.checkers.sample()
    lacking = [text for text in team.checkers.violations if text.startswith("I2")]
    assert lacking
    assert all(f"A1 still lacks {entry.name}" in text for text in lacking)


def test_i4_a_robot_that_is_taken_off_what_it_runs(run: Run) -> None:
    mission, program = example("explore")
    result = simulate(mission, program, seed=1, timeout_us=2 * SECOND_US)
    team = Team(agent for _, agent in sorted(result.agents.items()))
    process, ticket = team.processes[0], team.agents[0].view.action
    assert ticket is not None
    assert team.agents[0].view.plan is not None
    team.checkers.handling(process, TimerFired())  # type: ignore[arg-type]
    cancel = [CancelAction(ticket.number)]
    team.checkers.handled(process, TimerFired(), cancel)  # type: ignore[arg-type]
    assert "R1 is taken off explore(A)" in team.checkers.violations[0]
    # Not so if the operator says that everybody rests.
    team.checkers.violations.clear()
    inside.order(team.agents[0], OrderKind.PAUSE, 3 * SECOND_US)
    team.agents[0].handle(TimerFired(), 3 * SECOND_US)
    team.checkers.handled(process, TimerFired(), cancel)  # type: ignore[arg-type]
    assert team.checkers.violations == []


@pytest.mark.parametrize(("other", "found"), [("C1.1.n.1", []), ("C2.1.n.2", ["I4"])])
def test_i4_successes_of_different_coalitions(team: Team, other: str, found: list[str]) -> None:
    """Two robots lift the cover together; one of each of two coalitions does not."""
    agent = team.agents[0]
    assert agent.view.plan is not None
    (request,) = agent.view.plan.evaluation.requests
    for robot, token in (("C1", "C1.1.n.1"), ("C2", other)):
        name = f"{OUTCOME}/{request.activation}/move_frame/{token}"
        version = Version(agent.view.facts.members[robot].incarnation, 10_000)
        agent.view.facts.map.merge([make_entry(robot, name, version, [True, None])])
    with MUTATIONS["rounds_are_mixed"]():
        team.checkers.i3.check(team.processes[0], agent.view)  # type: ignore[arg-type]
    assert [text.partition(" at ")[0] for text in team.checkers.violations] == found


def test_i6_a_request_that_could_be_served_but_is_not(team: Team) -> None:
    """The cover needs two robots of type C; only C2 is there, until both can do it."""
    team.healed_us = 0

    def samples(count: int) -> None:
        for _ in range(count):
            team.clock.now_us += SECOND_US
            team.checkers.i6.sample()

    samples(60)
    assert team.checkers.violations == []
    assert team.checkers.i6.is_settled
    team.checkers.i6.is_settled = False
    for agent in team.agents:
        member, incarnation = agent.view.facts.members["A1"]
        able = dict(member.capabilities) | {"move_frame": 1_000_000}
        agent.view.facts.members["A1"] = dataclasses.replace(member, capabilities=able), incarnation
    samples(60)
    assert team.checkers.checks["I6"] == 1
    assert "I6" in {text[:2] for text in team.checkers.violations}
    assert "remove_cover::0 could be served" in team.checkers.violations[0]


@pytest.mark.parametrize("goes_on", [True, False])
def test_i6_a_mission_that_may_go_on_for_ever_has_to_go_on(team: Team, goes_on: bool) -> None:
    team.healed_us = team.clock.now_us
    checker, process = team.checkers.i6, team.processes[0]
    checker.is_endless = True
    entry = next(e for e in team.agents[0].view.facts.map if e.name.startswith(OUTCOME))
    for agent in team.agents:
        member, incarnation = agent.view.facts.members["A1"]
        able = dict(member.capabilities) | {"move_frame": 1_000_000}
        agent.view.facts.members["A1"] = dataclasses.replace(member, capabilities=able), incarnation
    while not checker.is_settled and team.clock.now_us < 200 * SECOND_US:
        team.clock.now_us += SECOND_US
        if goes_on:
            name = entry.name.replace("::0", f"::{team.clock.now_us}")
            again = make_entry(entry.author, name, entry.version, [True, None])
            done: Any = Persist((again,), synced=True)
            checker.handled(process, TimerFired(), [done])  # type: ignore[arg-type]
        checker.sample()
    assert checker.is_settled
    assert bool(team.checkers.violations) is not goes_on


def test_i6_coalitions_that_form_and_break_are_no_progress(team: Team) -> None:
    team.healed_us = team.clock.now_us
    checker, process = team.checkers.i6, team.processes[0]
    for agent in team.agents:
        member, incarnation = agent.view.facts.members["A1"]
        able = dict(member.capabilities) | {"move_frame": 1_000_000}
        agent.view.facts.members["A1"] = dataclasses.replace(member, capabilities=able), incarnation
    version = Version(Incarnation(1, "n"), 1)
    while not checker.is_settled and team.clock.now_us < 200 * SECOND_US:
        team.clock.now_us += SECOND_US
        scope, token = "sim1:4:remove_cover::0", f"C2.1.n.{team.clock.now_us}"
        names = {f"outcome/{scope}/move_frame/{token}": [True, None]}
        names |= {f"{BROKEN}/{scope}/{token}": True}
        entries = tuple(make_entry("C2", n, version, value) for n, value in names.items())
        done: Any = Persist(entries, synced=True)
        checker.handled(process, TimerFired(), [done])  # type: ignore[arg-type]
        checker.sample()
    assert "remove_cover::0 could be served" in team.checkers.violations[0]


def problem(*performance: dict[int, int], bounds: list[tuple[int, int]]) -> AssignmentProblem:
    robots = tuple(f"R{i}" for i in range(len(performance)))
    demands = tuple(Bounds(f"d{i}", *each) for i, each in enumerate(bounds))
    return AssignmentProblem.of(robots, demands, performance)


@pytest.mark.parametrize("seed", range(40))
def test_i7_brute_force_and_the_product_find_the_same(seed: int) -> None:
    choose = random.Random(seed)
    count = choose.randint(1, 3)
    performance = [
        {d: choose.choice([1, 2, 2]) for d in range(count) if choose.random() < 0.7}
        for _ in range(choose.randint(1, 5))
    ]
    bounds = [(low := choose.randint(0, 2), low + choose.randint(0, 2)) for _ in range(count)]
    given = problem(*performance, bounds=bounds)
    assert brute_force(given) == solve(given, min_cost_flow)


def test_i7_brute_force_takes_the_first_of_the_best() -> None:
    given = problem({0: 1, 1: 1}, {0: 1, 1: 1}, bounds=[(0, 1), (0, 1)])
    assert brute_force(given) == (0, 1)
    assert brute_force(problem({0: 1}, bounds=[(2, 2)])) is None


def test_i7_an_assignment_that_is_not_the_canonical_one() -> None:
    agent = _waiting_for_work()
    team = Team([agent])
    team.solver = lambda problem: [-1] * len(problem.robots)
    with pytest.raises(SolverError):
        team.checkers.i7.sample([agent.view])


def _waiting_for_work() -> Agent:
    """An agent whose plan has something to assign: two areas, and nobody is at them."""
    mission, program = example("explore")
    result = simulate(mission, program, seed=1, timeout_us=2 * SECOND_US)
    agent = result.agents["R1"]
    agent.view.facts.claims.clear()
    agent.view.facts.changes += 1
    return agent


def test_i7_a_plan_that_is_not_that_of_its_facts() -> None:
    agent = _waiting_for_work()
    team = Team([agent])
    team.checkers.i7.sample([agent.view])
    assert team.checkers.violations == []
    assert team.checkers.checks["I7"] == 1
    assert agent.view.plan is not None
    agent.view.facts.changes -= 1
    inside.planner(agent).plan = dataclasses.replace(agent.view.plan, lines={})
    team.checkers.i7.sample([agent.view])
    assert "the plan of R1 is not that of its facts" in team.checkers.violations[0]


def test_i9_what_was_synced_is_known_after_a_restart(team: Team) -> None:
    process: Any = team.processes[0]
    facts, checker = process.agent.view.facts.map, team.checkers.i9
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    checker.handled(process, [Persist((entry,), synced=True)])
    checker.booted(process, process.agent.view)
    assert team.checkers.violations == []
    facts.drop(entry.author, entry.name)
    checker.booted(process, process.agent.view)
    assert "A1 had synced outcome/" in team.checkers.violations[0]
    # A robot whose disk is gone has synced nothing.
    team.checkers.violations.clear()
    checker.lost_journal("A1")
    checker.booted(process, process.agent.view)
    assert team.checkers.violations == []


def test_i9_only_what_nothing_can_reach_is_forgotten(team: Team) -> None:
    process: Any = team.processes[0]
    agent, checker = process.agent, team.checkers.i9
    entry = next(entry for entry in agent.view.facts.map if entry.name.startswith(OUTCOME))
    forget = Forget(((entry.author, entry.name),))
    checker.handled(process, [Persist((entry,), synced=True), forget])
    assert "A1 forgets outcome/" in team.checkers.violations[0]
    team.checkers.violations.clear()
    agent.view.facts.run = "another"  # to which the entry does not belong
    checker.handled(process, [Persist((entry,), synced=True), forget])
    agent.view.facts.map.drop(entry.author, entry.name)
    checker.booted(process, agent.view)
    assert team.checkers.violations == []


def test_i9_no_version_has_two_contents(team: Team) -> None:
    process: Any = team.processes[0]
    version = Version(Incarnation(1, "n"), 1)
    for stamp in (3, 4):
        entry = make_entry("A1", "order", version, ["pause", stamp])
        team.checkers.i9.handled(process, [Persist((entry,), synced=True)])
    assert "for two contents" in team.checkers.violations[0]


def test_i9_what_a_robot_writes_stands(team: Team) -> None:
    """Unless an entry of an earlier life, with a higher incarnation, goes before it."""
    process: Any = team.processes[0]
    _, entries = inside.context(process.agent).replica.write([("order", ["pause", 9])], 0)
    team.checkers.i9.handled(process, [Persist(entries, synced=True)])
    assert team.checkers.violations == []
    late = make_entry("A1", "order", Version(Incarnation(0, "n"), 1), ["resume", 10])
    team.checkers.i9.handled(process, [Persist((late,), synced=True)])
    assert "A1 writes order" in team.checkers.violations[0]


def test_i9_nothing_is_told_before_it_is_synced(team: Team) -> None:
    process: Any = team.processes[0]
    data, entries = inside.context(process.agent).replica.write([("order", ["pause", 9])], 0)
    publish = Publish(MessageKind.FACT, data)
    team.checkers.i9.handled(process, [Persist(entries, synced=True), publish])
    assert team.checkers.violations == []
    data, entries = inside.context(process.agent).replica.write([("order", ["pause", 10])], 0)
    publish = Publish(MessageKind.FACT, data)
    team.checkers.i9.handled(process, [publish, Persist(entries, synced=True)])
    assert "A1 tells order" in team.checkers.violations[0]


def test_i9_a_finished_local_task_that_is_begun_again(team: Team) -> None:
    process: Any = team.processes[-1]
    facts = process.agent.view.facts.map
    entry = next(e for e in facts if e.name.startswith(OUTCOME) and e.author == process.robot)
    _, activation, local_task = entry.name.split("/")
    team.checkers.i9.handled(process, [Persist((entry,), synced=True)])
    again = StartAction(9, activation, "remove_screws", local_task, (), 1, Incarnation(1, "n"))
    team.checkers.i9.handled(process, [again])
    assert "C2 starts outcome/" in team.checkers.violations[0]


class Dosing:
    """Robots at an exclusive task, as the checker of I5 sees them."""

    def __init__(self, run: Run, in_doubt: InDoubtPolicy = InDoubtPolicy.HOLD) -> None:
        mission, program = example("dispense")
        tasks = dict(mission.global_tasks)
        tasks["dose(a)"] = dataclasses.replace(tasks["dose(a)"], in_doubt=in_doubt)
        result = simulate(mission, program, seed=1, timeout_us=SECOND_US)
        self.team = Team(agent for _, agent in sorted(result.agents.items()))
        self.team.mission = dataclasses.replace(mission, global_tasks=tasks)
        self.team.checkers = Checkers(self.team)  # type: ignore[arg-type]
        self.processes: dict[str, Any] = {p.robot: p for p in self.team.processes}

    def begin(self, robot: str, token: str, givers: int = 4) -> list[str]:
        process = self.processes[robot]
        for giver in list(self.processes.values())[:givers]:
            version = Version(giver.agent.view.incarnation, 1)
            grant = make_entry(giver.robot, f"{GRANT}/a:1/{token}", version, True)
            self.team.checkers.i5.handled(giver, [Persist((grant,), synced=True)])
        start = StartAction(
            7, "a:1", "dose(a)", "dose(a)", (), 1, process.agent.view.incarnation, token
        )
        self.team.checkers.i5.handled(process, [start])
        inside.context(process.agent).work.action = Ticket(7, "a:1", "dose(a)", "dose(a)", token)
        return [text.partition("which ")[2] or text for text in self.team.checkers.violations]

    def end(self, robot: str, event: Input) -> None:
        process = self.processes[robot]
        self.team.checkers.i5.handling(process, process.agent.view, event)


def test_i5_two_coalitions_at_once(run: Run) -> None:
    dosing = Dosing(run)
    assert dosing.begin("D1", "t1") == []
    (text,) = dosing.begin("D2", "t2")
    assert "D2 begins a:1 (t2) while D1 are at it (t1)" in text


def test_i5_two_coalitions_one_after_the_other_only_if_the_first_has_failed(run: Run) -> None:
    dosing = Dosing(run)
    dosing.begin("D1", "t1")
    dosing.end("D1", ActionFinished(7, success=False))
    assert dosing.begin("D2", "t2") == []
    dosing.end("D2", ActionFinished(7, success=True))
    assert dosing.begin("D1", "t3") == ["was finished (t2)"]
    assert dosing.team.checkers.i5.done_twice == 0
    dosing.end("D1", ActionFinished(7, success=True))
    assert dosing.team.checkers.i5.done_twice == 1


@pytest.mark.parametrize(
    ("policy", "found"),
    [(InDoubtPolicy.HOLD, ["was left in doubt (t1)"]), (InDoubtPolicy.RETRY, [])],
)
def test_i5_a_task_in_doubt(run: Run, policy: InDoubtPolicy, found: list[str]) -> None:
    dosing = Dosing(run, policy)
    dosing.begin("D1", "t1")
    dosing.end("D1", ActionStopped(7))
    assert dosing.begin("D2", "t2") == found


def test_i5_a_majority_has_to_grant_it(run: Run) -> None:
    half = len(Dosing(run).team.mission.robots) // 2
    assert Dosing(run).begin("D1", "t1", givers=half + 1) == []
    (text,) = Dosing(run).begin("D1", "t1", givers=half)
    assert text.startswith("only ")
    assert text.count(",") == half - 1


def test_i5_whoever_is_gone_or_frozen_does_nothing(run: Run) -> None:
    dosing = Dosing(run, InDoubtPolicy.RETRY)
    dosing.begin("D1", "t1")
    dosing.processes["D1"].runs = False
    assert dosing.begin("D2", "t2") == []
