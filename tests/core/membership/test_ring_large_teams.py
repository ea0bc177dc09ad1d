"""Teams in which not everybody is everybody's neighbour, in the simulator."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from benchmarks.membership.team import SteppedTeam
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.ring import SOUGHT_AT_A_TIME, Ring
from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs
from tests.support.effort import at_size, seeds
from tests.support.membership_view import recipients
from tests.support.patrols import GOOD, MS, NO_TOKENS, alive, patrol, started

BAD = NetworkKnobs(
    link=LinkKnobs(delay_us=MS, jitter_us=200 * MS, loss_permille=300), token_delay_us=None
)


def at_rest(robots: int) -> float:
    """Messages per robot and second."""
    team = started(robots, GOOD)
    before = team.sent
    team.run_until(team.now_us + 10 * SECOND_US)
    return (team.sent - before) / robots / 10


@pytest.mark.slow
def test_what_a_robot_sends_does_not_grow_with_its_team() -> None:
    sizes = at_size(quick=(7, 12, 24), gate=(7, 16, 32))
    small, medium, large = map(at_rest, sizes)
    assert large < 1.2 * medium
    assert large < small


@pytest.mark.parametrize("robots", [9, 24])
def test_a_killed_robot_is_replaced_after_a_few_messages(robots: int) -> None:
    team = started(robots, GOOD)
    victim, before = team.at_work()[0], team.sent
    team.kill(victim)
    team.run_until(team.now_us + 50 * MS)
    assert alive(team) == {robots - 1: robots - 1}
    assert len(team.at_work()) == robots // 2
    assert (team.sent - before) / robots < 40


@pytest.mark.slow
@pytest.mark.parametrize("robots", [9, 24])
def test_a_frozen_robot_is_found_in_the_detection_time_and_found_again(robots: int) -> None:
    team = started(robots, NO_TOKENS)
    timing = Timing().of_team(robots)
    victim = team.at_work()[0]
    team.freeze(victim)
    team.run_until(team.now_us + timing.detection_us + timing.heartbeat_us)
    assert alive(team) == {robots - 1: robots - 1}
    assert len(team.at_work()) == robots // 2
    team.thaw(victim)
    team.run_until(team.now_us + 2 * timing.detection_us)
    assert alive(team) == {robots: robots}


def heartbeat_of(has_joined: bool) -> Heartbeat:
    """The first one of a robot's life, in a mission of four nodes."""
    report = SelfReport(Incarnation(int(has_joined), "n"), 1, bytes(8), has_joined, 0)
    return Heartbeat(report, False, bytes(8), (0,) * 4, 0, (), {})


def test_a_newcomer_looks_for_those_that_it_has_not_heard() -> None:
    robots = [f"R{number:02}" for number in range(40)]
    members = Membership("R00", Timing().of_team(40), robots)
    beat = heartbeat_of(False)
    for robot in robots[1:21]:
        members.receive_heartbeat(robot, beat, 0)
    sought: set[str] = set()
    for number in range(1, 6):
        found = recipients(members.around, number, is_new=True)
        assert found is not None
        plain = recipients(members.around, number)
        assert plain is not None
        if number > 1:  # all that are new have had their answer
            assert len(set(found) - set(plain)) <= SOUGHT_AT_A_TIME
            assert len(set(found) - set(robots[1:21])) >= SOUGHT_AT_A_TIME
        sought |= set(found)
    assert sought >= set(robots[21:])


def test_who_knows_few_of_a_large_team_does_not_talk_to_all_of_it() -> None:
    robots = [f"R{number:02}" for number in range(40)]
    members = Membership("R00", Timing().of_team(40), robots)
    beat = heartbeat_of(False)
    for robot in robots[1:4]:
        members.receive_heartbeat(robot, beat, 0)
    found = recipients(members.around, 1, is_new=True)
    assert found is not None
    assert set(robots[1:4]) <= set(found)
    assert len(found) <= 3 + 1 + SOUGHT_AT_A_TIME


def test_that_a_robot_has_joined_is_told_by_its_facts_and_not_once_more() -> None:
    robots = 24
    team = started(robots, GOOD)
    told: Counter[str] = Counter()
    victim = team.at_work()[0]
    team.kill(victim)
    team.run_until(team.now_us + 3 * SECOND_US)
    team.on_beat = lambda source, target, _: told.update([target] if source == victim else [])
    team.launch(victim)
    team.run_until(team.now_us + Timing().of_team(robots).heartbeat_us)
    assert alive(team) == {robots: robots}
    assert len(told) == robots - 1, "all hear that it starts"
    assert sum(told.values()) < 3 * (robots - 1), "no other heartbeat goes to all"


def test_tokens_that_anybody_can_show_have_nobody_spoken_to() -> None:
    robots = [f"R{number:02}" for number in range(40)]
    members = Membership("R00", Timing().of_team(40), robots)
    beat = heartbeat_of(True)
    for robot in robots[1:]:
        members.receive_heartbeat(robot, beat, 0)
    recipients(members.around, 1)
    before = recipients(members.around, 2)
    for number in range(1_000):
        members.receive_token(f"X{number}", Incarnation(1, "n"), True)
        members.receive_token(robots[number % 39 + 1], Incarnation(number, "x"), True)
    assert recipients(members.around, 2) == before


def test_who_begins_together_is_planned_for_together(monkeypatch: pytest.MonkeyPatch) -> None:
    robots, plans = 24, 0
    take_up = Planner._take_up

    def counted(self: Planner, *plan: Any) -> None:
        nonlocal plans
        plans += 1
        take_up(self, *plan)

    monkeypatch.setattr(Planner, "_take_up", counted)
    started(robots, GOOD)
    assert plans / robots < robots // 2, "fewer than there are robots that have begun something"


def test_who_starts_again_hears_the_team_before_it_joins() -> None:
    """Its first heartbeats look older than its earlier life, of which it does not know."""
    robots = 16
    team = started(robots, GOOD)
    for robot in team.at_work()[:4]:
        team.kill(robot)
        team.run_until(team.now_us + SECOND_US)
        team.launch(robot)
        team.run_until(team.now_us + SECOND_US)
        agent = team.agent(robot)
        assert not agent.is_joining
        assert alive(team) == {robots: robots}
        assert len({each.facts.map.digest() for each in team.living()}) == 1


@pytest.mark.slow
def test_neighbours_that_die_together_are_all_found() -> None:
    robots = 20
    team = started(robots, NO_TOKENS)
    ring = Ring(team.mission.robots, Timing().reach)
    first = sorted(team.mission.robots)[0]
    gone = {first, *ring.neighbours(first)}
    for robot in gone:
        team.kill(robot)
    team.run_until(team.now_us + 2 * Timing().of_team(robots).max_detection_us)
    assert alive(team) == {robots - len(gone): robots - len(gone)}
    assert len(team.at_work()) == robots // 2


@pytest.mark.slow
def test_halves_that_were_cut_off_find_each_other_again() -> None:
    robots = 16
    team = started(robots, NO_TOKENS)
    left = set(sorted(team.mission.robots)[: robots // 2])
    links = [
        link
        for one in left
        for other in team.mission.robots.keys() - left
        for link in ((one, other), (other, one))
    ]
    team.network.block(links)
    timing = Timing().of_team(robots)
    team.run_until(team.now_us + 2 * timing.max_detection_us)
    assert alive(team) == {robots // 2: robots}
    team.network.unblock(links)
    team.run_until(team.now_us + 5 * timing.detection_us)
    assert alive(team) == {robots: robots}
    digests = {agent.facts.map.digest() for agent in team.living()}
    assert len(digests) == 1


def test_a_robot_that_hears_nothing_persuades_nobody() -> None:
    robots = 16
    team = started(robots, NO_TOKENS)
    deaf = sorted(team.mission.robots)[3]
    team.network.block([(other, deaf) for other in team.mission.robots if other != deaf])
    for _ in range(24):
        team.run_until(team.now_us + SECOND_US // 2)
        others = [agent for agent in team.living() if agent.robot != deaf]
        assert {len(agent.alive()) for agent in others} == {robots}


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(5))
def test_nobody_dies_of_loss_and_jitter(seed: int) -> None:
    robots = 24
    team = SteppedTeam(patrol(robots), BAD, seed)
    team.launch_all()
    team.run_until(30 * SECOND_US)
    for _ in range(60):
        team.run_until(team.now_us + SECOND_US)
        assert alive(team) == {robots: robots}, f"seed {seed} at {team.now_us / SECOND_US:.0f} s"


def test_one_broken_link_is_no_fault() -> None:
    robots = 12
    team = started(robots, NO_TOKENS)
    ring = Ring(team.mission.robots, Timing().reach)
    one = sorted(team.mission.robots)[0]
    other = ring.neighbours(one)[0]
    team.network.block([(one, other), (other, one)])
    for _ in range(60):
        team.run_until(team.now_us + SECOND_US // 2)
        assert alive(team) == {robots: robots}
