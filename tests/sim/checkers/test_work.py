"""I4 and I6: nobody works on what it may not, and what can be finished is finished."""

from __future__ import annotations

import dataclasses
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.agent.effects import CancelAction, Persist
from mrbt_mesh.core.agent.inputs import TimerFired
from mrbt_mesh.core.facts.records import OUTCOME, Claim, Phase, TeamOrder
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import KnownMember
from mrbt_mesh.core.membership.joining import Joining
from mrbt_mesh.features.exclusive.kinds import BROKEN
from mrbt_mesh.sim import AgentOptions, simulate
from mrbt_mesh.sim.checkers.findings import is_connected
from tests.support import behaviour, inside
from tests.support.build import action, keep_running, make_mission
from tests.support.checked_team import SECOND_US, Team, start
from tests.support.mutations import MUTATIONS
from tests.support.runs import Run, example


def enable(team: Team, local_task: str) -> None:
    """From now on A1 can do it too."""
    for agent in team.agents:
        member, incarnation = agent.view.facts.members["A1"]
        able = dict(member.capabilities) | {local_task: 1_000_000}
        described = dataclasses.replace(member, capabilities=able)
        agent.view.facts.members["A1"] = KnownMember(described, incarnation)


def test_i4_work_that_a_robot_cannot_do(team: Team) -> None:
    assert start(team, "A1", "remove_cover", "move_frame") == ["I4"]


def test_i4_more_robots_at_once_than_are_allowed(team: Team) -> None:
    activation = f"{team.agents[0].view.facts.run}:4:remove_cover::0"
    for agent in team.agents[:3]:
        inside.pretend_to_work(agent, activation, "remove_cover", "move_frame")
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
    monkeypatch.setattr("mrbt_mesh.core.planning.make_plan.optimum", lambda *_: None)
    for agent in team.agents:
        agent.view.facts.claims.clear()
        agent.view.facts.changes += 1
        inside.context(agent).work.claim = None
    assert "I4" in team.sample()
    assert any(
        "0 robots on explore" in text and text.endswith(": 1..1")
        for text in team.checkers.violations
    )


def test_i6_a_team_at_work_has_only_been_given_too_little_time() -> None:
    mission, program = example("explore")
    result = simulate(mission, program, seed=1, timeout_us=2 * SECOND_US)
    assert (result.result, result.violations) == ("timeout", [])


@pytest.mark.slow
def test_i6_a_mission_that_never_ends_is_no_violation() -> None:
    """One robot looks for ever: it ends with the time that it was given."""
    mission = make_mission(keep_running(action("look")))
    program = RobotProgram()

    @program.local_task("look")
    async def look(task: TaskContext) -> None:
        await anyio.sleep(0.2)

    result = simulate(mission, program, seed=1, timeout_us=120 * SECOND_US)
    assert (result.result, result.violations) == ("timeout", [])
    assert result.summary["global_tasks"]["look"]["status"] == "running"


def test_i6_a_team_that_could_finish_and_does_nothing(team: Team) -> None:
    """At the timeout nobody works, nothing was finished for long, and all could be served."""
    team.checkers.i6.timed_out()
    assert team.checkers.violations == [], "the cover needs two robots of type C"
    enable(team, "move_frame")
    team.checkers.i6.timed_out()
    assert (
        "could finish the mission, but nothing was finished for 100.0 s"
        in (team.checkers.violations[0])
    )
    team.checkers.violations.clear()
    activation = f"{team.agents[0].view.facts.run}:4:remove_cover::0"
    inside.pretend_to_work(team.agents[0], activation, "remove_cover", "move_frame")
    team.checkers.i6.timed_out()
    assert team.checkers.violations == []


def test_i6_robots_that_do_not_stop(team: Team) -> None:
    team.checkers.i6.never_stopped()
    assert "A1, A2, B1, B2, C2 did not stop" in team.checkers.violations[0]


def test_i6_a_robot_that_does_not_join(team: Team) -> None:
    team.healed_us = 0
    agent = team.agents[0]
    inside.context(agent).joining = Joining(team.timing, frozenset(), team.clock.now_us)
    team.checkers.run.fault_came()
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


def test_i4_a_robot_that_is_taken_off_what_it_runs(run: Run) -> None:
    mission, program = example("explore")
    result = simulate(mission, program, seed=1, timeout_us=2 * SECOND_US)
    team = Team(agent for _, agent in sorted(result.agents.items()))
    process, ticket = team.processes[0], team.agents[0].view.action
    assert ticket is not None
    assert team.agents[0].view.plan is not None
    team.checkers.handling(process, TimerFired())  # type: ignore[arg-type]
    cancel = [CancelAction(ticket.ticket)]
    team.checkers.handled(process, TimerFired(), cancel)  # type: ignore[arg-type]
    assert "R1 is taken off explore(A)" in team.checkers.violations[0]
    # Not so if the operator says that everybody rests.
    team.checkers.violations.clear()
    inside.command(team.agents[0], TeamOrder.PAUSE, 3 * SECOND_US)
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
        agent.view.facts.map.merge([parse_entry(robot, name, version, [True, None])])
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
    enable(team, "move_frame")
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
            again = parse_entry(entry.author, name, entry.version, [True, None])
            done: Any = Persist((again,), at_once=True)
            checker.handled(process.agent.view, [done])
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
        entries = tuple(parse_entry("C2", n, version, value) for n, value in names.items())
        done: Any = Persist(entries, at_once=True)
        checker.handled(process.agent.view, [done])
        checker.sample()
    assert "remove_cover::0 could be served" in team.checkers.violations[0]


def test_i4_nobody_is_missed_once_the_mission_has_ended() -> None:
    """`place` ends the mission and clears what led to it: the tree asks for `pick`, in vain."""
    text = """
mission: hand
parameters: {behave: {pick: {sets: {holding: true}}, place: {sets: {holding: false}}}}
local_tasks: {pick: {}, place: {}}
conditions: {holding: {}}
robot_types: {T: {capabilities: {pick: 1, place: 1}}}
robots: {R1: T}
global_tasks: {pick: {needs: {pick: {}}}, place: {needs: {place: {}}}}
tree: {Sequence: [{Fallback: [{Condition: holding}, pick]}, place]}
"""
    result = simulate(
        behaviour.mission_of(text),
        behaviour.robot,
        seed=1,
        agents=AgentOptions(exit_when_done=False),
        timeout_us=30 * SECOND_US,
    )
    plan = result.agents["R1"].view.plan
    assert plan is not None
    assert [request.subject for request in plan.evaluation.requests] == ["pick"]
    assert (result.result, result.violations) == ("success", [])
    assert result.checks["I4"]
