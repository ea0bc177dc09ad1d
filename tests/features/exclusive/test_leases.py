"""Grants: a majority, leases by both clocks, restarts; never two holders at the same time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.core.facts.store import Fact, Incarnation, Version, make_entry, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.peer_clocks import PeerClocks
from mrbt_mesh.core.membership.replica import Durability
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, RequestAnswer, SelfReport
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.exclusive.fields import InDoubtPolicy
from mrbt_mesh.features.exclusive.leases import Leases
from mrbt_mesh.features.exclusive.records import CoalitionId
from tests.support.build import RUN, action, make_mission, task

TIMING = Timing()
LEASE_US = TIMING.promise_us
NAME = "r1:0:dose::0"
TOKENS = {robot: CoalitionId(7, robot, 1, "n") for robot in "ABCDE"}


def mission(count: int, in_doubt: InDoubtPolicy) -> Mission:
    robots = {name: {"pour": 1} for name in "ABCDE"[:count]}
    dose = task("dose", ("pour", 1, 1), exclusive=True, in_doubt=in_doubt)
    return make_mission(action("dose"), robots, [dose])


@dataclass
class Robot:
    """One robot with nothing but its grants, its facts, and a clock of its own."""

    id: str
    mission: Mission
    rate_percent: int = 100
    offset_us: int = 0
    facts: TeamFacts = field(init=False)
    grants: Leases = field(init=False)
    number: int = 0
    sequence: int = 0
    disk: Durability = field(default_factory=Durability)
    is_disk_slow: bool = False

    def __post_init__(self) -> None:
        self.facts = TeamFacts(self.mission, RUN)
        self.start(0)
        self.grants.grantor.end_silence()

    def start(self, now_us: int) -> None:
        """A new process, with the facts of the journal."""
        self.clocks = PeerClocks(TIMING)
        self.grants = Leases(
            self.id, self.facts, TIMING, self.clock(now_us), self.disk, self.clocks
        )

    def clock(self, now_us: int) -> int:
        return self.offset_us + now_us * self.rate_percent // 100

    def write(self, facts: Sequence[Fact]) -> None:
        for name, record in facts:
            self.sequence += 1
            version = Version(Incarnation(1, "n"), self.sequence)
            self.facts.map.merge([make_entry(self.id, name, version, record)])

    def promise(self, facts: Sequence[Fact]) -> None:
        if facts:
            self.write(facts)
            self.grants.grantor.written(self.disk.take_number())
            if not self.is_disk_slow:
                self.sync()

    def sync(self) -> None:
        self.disk.note_synced(self.disk.take_number())
        self.grants.take_own_answers()

    def beat(self, now_us: int) -> Heartbeat:
        self.number += 1
        self.promise(self.grants.heartbeat_sent(self.number, self.clock(now_us), lambda *_: True))
        return Heartbeat(
            SelfReport(Incarnation(1, "n"), self.number, b"", True, 0),
            False, b"", (0, 0, 0, 0), 0, (), {},
            self.grants.holder.requested, self.grants.grantor.grants(),
        )  # fmt: skip

    def hear(self, other: str, beat: Heartbeat, now_us: int) -> None:
        granted = self.grants.receive_heartbeat(other, beat, self.clock(now_us), lambda *_: True)
        self.promise(granted)

    def pass_to(self, now_us: int) -> None:
        self.write(self.grants.grantor.expire(self.clock(now_us)))

    def holds(self, now_us: int) -> bool:
        return self.grants.holder.is_held(NAME, TOKENS[self.id], self.clock(now_us))


def team(count: int, in_doubt: InDoubtPolicy = InDoubtPolicy.RETRY) -> dict[str, Robot]:
    shared = mission(count, in_doubt)
    return {name: Robot(name, shared) for name in shared.robots}


def exchange(one: Robot, other: Robot, now_us: int) -> None:
    """A request and its answer."""
    other.hear(one.id, one.beat(now_us), now_us)
    one.hear(other.id, other.beat(now_us), now_us)


def test_a_majority_of_the_missions_robots_is_needed() -> None:
    robots = team(5)
    a = robots["A"]
    a.grants.holder.request(NAME, TOKENS["A"])
    exchange(a, robots["B"], 10)
    assert not a.holds(10)
    exchange(a, robots["C"], 20)
    assert a.holds(20)


def test_a_grant_counts_once_it_is_on_disk() -> None:
    robots = team(3)
    a, b = robots["A"], robots["B"]
    a.is_disk_slow = b.is_disk_slow = True
    a.grants.holder.request(NAME, TOKENS["A"])
    exchange(a, b, 10)
    assert not a.holds(10)
    b.sync()
    exchange(a, b, 20)
    assert not a.holds(20)  # a majority with itself, and its own is not on disk
    a.sync()
    assert a.holds(20)
    assert not a.holds(20 + TIMING.hold_us)


def test_whose_journal_fails_grants_nothing_new_and_keeps_what_it_gave() -> None:
    robots = team(3)
    a, b, c = robots["A"], robots["B"], robots["C"]
    b.disk.is_failing = True
    a.grants.holder.request(NAME, TOKENS["A"])
    exchange(a, b, 10)
    assert not a.holds(10)
    exchange(a, c, 20)
    assert a.holds(20)
    c.disk.is_failing = True
    exchange(a, c, TIMING.hold_us)
    assert a.holds(TIMING.hold_us + 1)


def test_the_holder_counts_from_when_it_asked_and_for_less_than_the_lease() -> None:
    robots = team(3)
    a, b = robots["A"], robots["B"]
    a.grants.holder.request(NAME, TOKENS["A"])
    request = a.beat(0)
    b.hear("A", request, 500_000)  # it took its time
    a.hear("B", b.beat(500_000), 600_000)
    assert a.holds(TIMING.hold_us - 1)
    assert not a.holds(TIMING.hold_us)
    b.pass_to(LEASE_US + 499_999)
    assert [grant.party for grant in b.grants.grantor.grants()] == [str(TOKENS["A"])]
    b.pass_to(LEASE_US + 500_000)
    assert b.grants.grantor.grants() == ()
    assert b.facts.map.get("B", f"doubt/{NAME}/{TOKENS['A']}") is not None


def test_renewals_keep_it() -> None:
    robots = team(3)
    for now_us in range(0, 4 * LEASE_US, TIMING.heartbeat_us):
        robots["A"].grants.holder.request(NAME, TOKENS["A"])
        exchange(robots["A"], robots["B"], now_us)
        for robot in robots.values():
            robot.pass_to(now_us)
        assert robots["A"].holds(now_us)


def test_a_second_coalition_gets_nothing_while_the_first_may_be_at_it() -> None:
    robots = team(3)
    a, b, c = robots.values()
    a.grants.holder.request(NAME, TOKENS["A"])
    exchange(a, c, 0)
    b.grants.holder.request(NAME, TOKENS["B"])
    exchange(b, c, 10)
    assert a.holds(10)
    assert not b.holds(10)
    c.pass_to(LEASE_US)
    exchange(b, c, LEASE_US)
    assert b.holds(LEASE_US)


@pytest.mark.parametrize("policy", [InDoubtPolicy.HOLD, InDoubtPolicy.FAIL])
def test_unless_it_is_to_be_tried_again_a_giver_excludes_all_others_for_good(
    policy: InDoubtPolicy,
) -> None:
    robots = team(3, policy)
    a, b, c = robots.values()
    a.grants.holder.request(NAME, TOKENS["A"])
    exchange(a, c, 0)
    b.grants.holder.request(NAME, TOKENS["B"])
    for now_us in (LEASE_US, 3 * LEASE_US):
        c.pass_to(now_us)
        exchange(b, c, now_us)
        assert not b.holds(now_us)
    c.start(4 * LEASE_US)  # it is in its journal
    c.pass_to(6 * LEASE_US)
    exchange(b, c, 6 * LEASE_US)
    assert not b.holds(6 * LEASE_US)


def test_grants_that_were_never_used_are_set_free_by_the_leader() -> None:
    robots = team(3, InDoubtPolicy.HOLD)
    a, b, c = robots.values()
    a.grants.holder.request(NAME, TOKENS["A"])
    exchange(a, c, 0)
    version = Version(Incarnation(1, "n"), 99)
    cleared = parse_entry("A", f"cleared/{NAME}/{TOKENS['A']}", version, True)
    c.facts.map.merge([cleared])
    c.pass_to(10)
    b.grants.holder.request(NAME, TOKENS["B"])
    exchange(b, c, 20)
    assert b.holds(20)


def test_a_restarted_robot_grants_nothing_for_a_lease() -> None:
    robots = team(3)
    a, b, _ = robots.values()
    b.start(0)
    a.grants.holder.request(NAME, TOKENS["A"])
    exchange(a, b, LEASE_US - 1)
    assert not a.holds(LEASE_US - 1)
    exchange(a, b, LEASE_US)
    assert a.holds(LEASE_US)


def test_robots_that_the_mission_does_not_name_grant_nothing() -> None:
    shared = mission(3, InDoubtPolicy.HOLD)
    a, stranger = Robot("A", shared), Robot("E", shared)
    a.grants.holder.request(NAME, TOKENS["A"])
    exchange(a, stranger, 0)
    a.hear("E", grants_of("A", 1), 5)
    assert not a.holds(10)


def grants_of(member: str, number: int) -> Heartbeat:
    granted = (RequestAnswer(str(TOKENS[member]), member, number),)
    return Heartbeat(
        SelfReport(Incarnation(1, "n"), 1, b"", True, 0),
        False, b"", (0, 0, 0, 0), 0, (), {}, None, granted,
    )  # fmt: skip


def test_an_answer_to_a_beat_that_was_never_sent_counts_for_nothing() -> None:
    robots = team(3)
    a = robots["A"]
    a.grants.holder.request(NAME, TOKENS["A"])
    a.beat(0)
    a.hear("B", grants_of("A", 77), 10)
    assert not a.holds(10)


def test_a_robot_that_only_knows_of_a_grant_says_when_it_must_have_run_out() -> None:
    robots = team(3)
    c = robots["C"]
    version = Version(Incarnation(1, "n"), 1)
    c.facts.map.merge([parse_entry("B", f"grant/{NAME}/{TOKENS['A']}", version, True)])
    c.pass_to(0)
    assert c.grants.grantor.grants() == ()
    c.pass_to(LEASE_US)
    assert c.facts.map.get("C", f"doubt/{NAME}/{TOKENS['A']}") is not None


OPERATIONS = st.one_of(
    st.tuples(st.just("wait"), st.integers(1, LEASE_US), st.just(0)),
    st.tuples(st.just("exchange"), st.integers(0, 1), st.integers(0, 31)),
    st.tuples(st.just("exchange"), st.integers(0, 1), st.integers(0, 31)),
    st.tuples(st.just("send"), st.integers(0, 4), st.integers(0, 31)),
    st.tuples(st.just("send"), st.integers(0, 1), st.integers(0, 31)),
    st.tuples(st.just("arrive"), st.integers(0, 40), st.just(0)),
    st.tuples(st.just("arrive"), st.integers(0, 40), st.just(0)),
    st.tuples(st.just("restart"), st.integers(0, 4), st.just(0)),
    st.tuples(st.just("share"), st.integers(0, 4), st.integers(0, 4)),
)


class Contest:
    """Two robots that both want the task, and messages that arrive whenever they like."""

    def __init__(self, robots: list[Robot]) -> None:
        self.robots = robots
        self.now_us = 0
        self.mail: list[tuple[Robot, str, Heartbeat]] = []
        for holder in robots[:2]:
            holder.grants.holder.request(NAME, TOKENS[holder.id])

    def do(self, kind: str, first: int, second: int) -> None:
        getattr(self, kind)(first, second)
        for robot in self.robots:
            robot.pass_to(self.now_us)

    def robot(self, number: int) -> Robot:
        return self.robots[number % len(self.robots)]

    def chosen(self, mask: int, but: Robot) -> list[Robot]:
        return [r for i, r in enumerate(self.robots) if mask >> i & 1 and r is not but]

    def wait(self, duration_us: int, _: int) -> None:
        self.now_us += duration_us

    def exchange(self, holder: int, mask: int) -> None:
        for other in self.chosen(mask, self.robot(holder)):
            exchange(self.robot(holder), other, self.now_us)

    def send(self, sender: int, mask: int) -> None:
        beat = self.robot(sender).beat(self.now_us)
        receivers = self.chosen(mask, self.robot(sender))
        self.mail += [(receiver, self.robot(sender).id, beat) for receiver in receivers]

    def arrive(self, number: int, _: int) -> None:
        if self.mail:  # in any order, perhaps again
            receiver, source, beat = self.mail[number % len(self.mail)]
            receiver.hear(source, beat, self.now_us)

    def restart(self, number: int, _: int) -> None:
        """The journal has all of the facts; an action dies with its process."""
        self.robot(number).start(self.now_us)

    def share(self, one: int, other: int) -> None:
        self.robot(one).facts.map.merge(list(self.robot(other).facts.map))


@settings(max_examples=300)
@given(
    st.integers(3, 5),
    st.lists(st.integers(90, 110), min_size=5, max_size=5),
    st.lists(st.integers(0, 10**9), min_size=5, max_size=5),
    st.lists(OPERATIONS, min_size=10, max_size=80),
)
def test_two_robots_never_hold_one_task_at_the_same_time(
    count: int, rates: list[int], offsets: list[int], operations: list[tuple[str, int, int]]
) -> None:
    """Whatever is lost, late, doubled or restarted, with clocks that run 10 % fast or slow."""
    shared = mission(count, InDoubtPolicy.RETRY)
    clocks = zip(shared.robots, rates, offsets, strict=False)
    contest = Contest([Robot(name, shared, rate, offset) for name, rate, offset in clocks])
    for operation in operations:
        contest.do(*operation)
        assert sum(robot.holds(contest.now_us) for robot in contest.robots) <= 1
