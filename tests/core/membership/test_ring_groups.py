"""How a large team agrees without everybody hearing everybody; and bugs that this would not bear.

Each deliberate bug makes one of the stories fail, which without it is true.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.membership.team import SteppedTeam
from mrbt_mesh.core.agent import heartbeats
from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.dissemination import Urgent
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.peer import ArrivalHistory, Peer, State
from mrbt_mesh.core.membership.ring import (
    REPRESENTATIVES,
    PlanRecipients,
    Ring,
    RingDissemination,
    RingGroup,
    place,
)
from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from mrbt_mesh.core.membership.wire import SelfReport
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs
from tests.support.patrols import MS, patrol

DIGEST, OTHER = b"planned.", b"another."
names = st.text("ABCR0123456789", min_size=1, max_size=6)


def peer(state: State = State.ALIVE, digest: bytes = DIGEST, has_joined: bool = True) -> Peer:
    life, timing = Incarnation(1, "n"), Timing()
    report = SelfReport(life, 1, digest, has_joined, 0)
    return Peer(life, report, 0, ArrivalHistory.of_new_robot(timing), 0, 0, state=state)


# -- groups ---------------------------------------------------------------------------------


@given(st.sets(names, min_size=1, max_size=80), st.integers(1, 3), st.sets(names, max_size=5))
def test_every_robot_is_in_one_group_of_those_that_stand_beside_it(
    mission: set[str], reach: int, strangers: set[str]
) -> None:
    known = {robot: RingGroup(robot, mission, {}, reach) for robot in mission | strangers}
    order = sorted(mission, key=lambda robot: (place(robot), robot))
    found = [known[robot].number_of(robot) for robot in order]
    assert found == sorted(found)
    for robot, groups in known.items():
        mine = {each for each in mission if known[each].number_of(each) == groups.number_of(robot)}
        assert set(groups.members) == mine | {robot}
    sizes = [found.count(number) for number in set(found)]
    assert all(size >= 2 * reach + 1 for size in sizes[:-1])
    assert max(sizes) <= max(2 * reach + 1, len(mission) ** 0.5 + 1)
    assert len(sizes) <= len(mission) ** 0.5 + 1


def test_a_team_in_which_all_are_neighbours_is_one_group() -> None:
    robots = [f"R{number}" for number in range(7)]
    assert set(RingGroup("R0", robots, {}, 3).members) == set(robots)


def test_the_first_in_good_standing_speak_and_the_rest_are_those_who_count() -> None:
    robots = [f"R{number}" for number in range(7)]
    peers = {robot: peer() for robot in robots[1:]}
    groups = RingGroup("R0", robots, peers, 3)
    representatives = groups.representatives()
    assert representatives == groups.members[:REPRESENTATIVES]
    gone = next(robot for robot in representatives if robot != "R0")
    for state in (State.SUSPECT, State.DEAD, State.LEFT):
        peers[gone] = peer(state, OTHER)
        assert gone not in groups.representatives()
        assert len(groups.representatives()) == REPRESENTATIVES
        assert gone not in groups.reports()
        assert groups.all_report(DIGEST)
    peers[gone] = peer(digest=OTHER)
    assert not groups.all_report(DIGEST)
    peers[gone] = peer(has_joined=False)
    assert not groups.all_report(DIGEST)


# -- stories ----------------------------------------------------------------------------------

ROBOTS = 24


def started(robots: int = ROBOTS, token_delay_us: int | None = 5 * MS) -> SteppedTeam:
    """A team at work: half of it has something to do."""
    network = NetworkKnobs(LinkKnobs(delay_us=MS, jitter_us=0), token_delay_us=token_delay_us)
    team = SteppedTeam(patrol(robots), network, 1, is_shared=True)
    team.launch_all()
    team.run_until(8 * SECOND_US)
    assert len(team.at_work()) == robots // 2
    return team


def represents(team: SteppedTeam, robot: str) -> bool:
    """Whether it represents its group."""
    peers = team.agent(robot).peers
    return robot in RingGroup(robot, team.mission.robots, peers, Timing().reach).representatives()


def replaced_at_once() -> None:
    """Somebody dies; another robot goes on long before the time after which it need not ask."""
    team = started()
    victim = team.at_work()[0]
    team.kill(victim)
    team.run_until(team.now_us + 50 * MS)
    assert len(team.at_work()) == ROBOTS // 2


def waits_for_who_plans_otherwise() -> None:
    """A robot has missed a fact; until it has it nobody begins what follows from it, then soon."""
    team = started()
    loser = team.at_work()[0]
    free = sorted(team.mission.robots.keys() - set(team.at_work()))
    near = Ring(team.mission.robots, Timing().reach).neighbours(free[0])
    late = next(robot for robot in free[1:] if robot not in near and not represents(team, robot))
    missed = [(loser, late)]
    before = set(team.at_work())
    team.network.block(missed)
    team.give(loser, CapabilityChanged("watch", lost=True))
    team.run_until(team.now_us + 20 * MS)
    team.network.unblock(missed)
    plans = {agent.robot: agent.plan.digest for agent in team.living() if agent.plan is not None}
    assert [robot for robot in plans if plans[robot] != plans[loser]] == [late]
    team.run_until(team.now_us + 60 * MS)
    assert not set(team.at_work()) - before
    team.run_until(team.now_us + Timing().of_team(ROBOTS).grace_us - 100 * MS)
    assert set(team.at_work()) - before == {free[0]}


def found_when_frozen() -> None:
    """Nobody takes its token down, and only its silence tells."""
    team, timing = started(token_delay_us=None), Timing().of_team(ROBOTS)
    team.run_until(20 * SECOND_US)
    team.freeze(team.at_work()[0])
    team.run_until(team.now_us + timing.detection_us + timing.heartbeat_us)
    assert {len(agent.alive()) for agent in team.living()} == {ROBOTS - 1}
    assert len(team.at_work()) == ROBOTS // 2


STORIES = {
    story.__name__: story
    for story in (replaced_at_once, waits_for_who_plans_otherwise, found_when_frozen)
}


@pytest.mark.parametrize("story", STORIES)
def test_a_large_team_goes_on(story: str) -> None:
    STORIES[story]()


# -- deliberate bugs --------------------------------------------------------------------------

Bug = Callable[[], contextlib.AbstractContextManager[Any]]
BUGS: dict[str, tuple[str, Bug]] = {}


def caught_by(story: Callable[[], None]) -> Callable[[Callable[[], Iterator[None]]], None]:
    def register(bug: Callable[[], Iterator[None]]) -> None:
        BUGS[bug.__name__] = story.__name__, contextlib.contextmanager(bug)

    return register


@caught_by(waits_for_who_plans_otherwise)
def representatives_vouch_for_their_groups() -> Iterator[None]:
    """A representative says at once that all of its group plan what it plans, unheard."""

    def all_report(self: RingGroup, digest: bytes) -> bool:
        said[id(self)] = digest
        return True

    def reports(self: RingGroup) -> Mapping[str, SelfReport]:
        return {
            robot: replace(report, plan_digest=said[id(self)], number=report.number + 1)
            for robot, report in original(self).items()
        }

    said: dict[int, bytes] = {}
    original = RingGroup.reports
    with (
        mock.patch.object(RingGroup, "reports", reports),
        mock.patch.object(RingGroup, "all_report", all_report),
    ):
        yield


@caught_by(waits_for_who_plans_otherwise)
def only_neighbours_have_to_agree() -> Iterator[None]:
    """A robot begins once those agree whom it judges."""

    def all_report_plan(self: Membership, digest: bytes) -> bool:
        judged = self.around.judged.values()
        return all(each.report.plan_digest == digest for each in judged)

    with mock.patch.object(Membership, "all_report_plan", all_report_plan):
        yield


@caught_by(waits_for_who_plans_otherwise)
def half_of_the_team_counts() -> Iterator[None]:
    """A robot begins once half of the team agrees."""

    def all_report_plan(self: Membership, digest: bytes) -> bool:
        agree = sum(each.report.plan_digest == digest for each in self.peers.values())
        return 2 * agree > len(self.peers)

    with mock.patch.object(Membership, "all_report_plan", all_report_plan):
        yield


@caught_by(replaced_at_once)
def representatives_are_silent() -> Iterator[None]:
    """Nobody passes on what a group has planned."""
    with mock.patch.object(heartbeats, "who_waits", return_value=set()):
        yield


@caught_by(replaced_at_once)
def representatives_are_not_notified() -> Iterator[None]:
    """Of another plan only neighbours hear."""

    def of_heartbeat(self: PlanRecipients, *which: Any) -> Any:
        found, relays = original(self, *which)
        return found - set(self._group.representatives()), relays

    original = PlanRecipients.of_heartbeat
    with mock.patch.object(PlanRecipients, "of_heartbeat", of_heartbeat):
        yield


@caught_by(replaced_at_once)
def neighbours_keep_deaths_to_themselves() -> Iterator[None]:
    """What everybody is to hear is told to neighbours alone."""

    def route(self: RingDissemination, urgent: Urgent, *rest: Any) -> Any:
        return original(self, urgent._replace(broadcast=self._sent_broadcast), *rest)

    original = RingDissemination.route
    with mock.patch.object(RingDissemination, "route", route):
        yield


@caught_by(found_when_frozen)
def neighbours_judge_nobody() -> Iterator[None]:
    """In a large team silence says nothing."""

    def follow(self: RingDissemination) -> None:
        original(self)
        self._judged = {}

    original = RingDissemination._follow
    with mock.patch.object(RingDissemination, "_follow", follow):
        yield


@caught_by(found_when_frozen)
def nobody_believes_in_deaths() -> Iterator[None]:
    """A robot holds for dead only whom it judges itself."""
    with mock.patch.object(RingDissemination, "is_given_up", return_value=False):
        yield


@pytest.mark.slow
@pytest.mark.parametrize("bug", BUGS)
def test_a_deliberate_bug_is_caught(bug: str) -> None:
    story, broken = BUGS[bug]
    with broken(), pytest.raises(AssertionError):
        STORIES[story]()
