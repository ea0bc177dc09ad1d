"""Which robots' clocks are believed, and what a robot says of its own."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.agent.wall_clock import TOLERANCE_US, WallClock
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport

S = 1_000_000
UNIX_US = 1_700_000_000 * S
BEAT = Heartbeat(
    SelfReport(Incarnation(1, "n"), 1, bytes(8), True, 1), False, bytes(8), (0, 0, 0, 0), 0, (), {}
)


class Clock:
    """A robot's wall clock, its monotonic clock at 0 when the true time is UNIX_US."""

    def __init__(self, ahead_us: int = 0) -> None:
        self.members = Membership("Me", Timing(), ())
        self.clock = WallClock(self.members, 250_000)
        self.now_us = 0
        self.set(ahead_us)

    def set(self, ahead_us: int) -> None:
        self.clock.read(UNIX_US + ahead_us, self.now_us)

    def hear(self, *ahead_us: int, delay_us: int = 0) -> bool:
        """One heartbeat of each of the others later: whether anything has changed."""
        self.now_us += 250_000
        for robot, each_us in enumerate(ahead_us):
            report = dataclasses.replace(BEAT.report, number=self.now_us)
            unix_us = UNIX_US + self.now_us - delay_us + each_us
            beat = dataclasses.replace(BEAT, report=report, unix_us=unix_us)
            self.members.receive_heartbeat(f"R{robot}", beat, self.now_us)
        return self.clock.compare(self.now_us)

    def lose_all(self) -> None:
        self.now_us += 60 * S
        while self.members.members():
            self.members.detect_failures(self.now_us)
            self.now_us += S

    @property
    def shown(self) -> tuple[bool, str]:
        return self.clock.is_believed, self.clock.problem.partition(",")[0]


AHEAD = "its clock is 3600 s ahead of the team's"
HOUR = 3_600 * S


@pytest.mark.parametrize(
    ("mine", "others", "expected"),
    [
        (0, [], (True, "")),
        (HOUR, [], (True, "")),
        (0, [400_000, -400_000], (True, "")),
        (HOUR, [0, 0], (False, AHEAD)),
        (-90 * S, [0, 0], (False, "its clock is 90 s behind the team's")),
        (0, [HOUR, 0], (True, "")),
        # Of two the earlier one: what is late is better than what is lost.
        (HOUR, [0], (False, AHEAD)),
        (0, [HOUR], (True, "")),
        (0, [-HOUR], (False, AHEAD)),
    ],
)
def test_a_clock_that_is_off_says_so_and_is_not_believed(
    mine: int, others: list[int], expected: tuple[bool, str]
) -> None:
    found = Clock(mine)
    found.hear(*others)
    found.hear(*others)
    assert found.shown == expected
    assert (found.clock.when_us(UNIX_US) is None) is not expected[0]


def test_what_changes_is_reported_once() -> None:
    found = Clock(HOUR)
    assert found.hear(0, 0)
    assert not found.hear(0, 0)
    assert not found.hear(400_000, 400_000), "a little more is nothing new"
    found.set(2 * HOUR)
    assert found.clock.when_us(UNIX_US) is None, "at once"
    assert found.hear(0, 0)
    assert found.shown == (False, "its clock is 7200 s ahead of the team's")
    found.set(0)
    assert found.hear(0, 0)
    assert found.shown == (True, "")


def test_heartbeats_that_have_waited_are_no_problem() -> None:
    found = Clock()
    found.hear(0, 0)
    found.hear(0, 0, delay_us=5 * S)
    assert found.shown == (False, "")
    found.hear(0, 0)
    assert found.shown == (True, "")


def test_who_hears_nobody_any_more_keeps_what_it_found_until_its_clock_is_set() -> None:
    found = Clock(HOUR)
    found.hear(0, 0)
    found.lose_all()
    found.hear()
    assert found.shown == (False, AHEAD)
    assert found.clock.team_us(7) == UNIX_US + 7
    found.set(5 * S)
    found.hear()
    assert found.shown == (True, "")


def test_a_clock_that_was_set_is_compared_with_what_is_heard_afterwards() -> None:
    found = Clock()
    found.hear(0, 0)
    found.set(HOUR)
    found.hear()
    assert found.shown == (False, ""), "the others are there, but were not heard since"
    found.hear(0)
    assert found.shown == (False, AHEAD)


small = st.integers(-400_000, 400_000)


@given(
    goods=st.lists(small, min_size=1, max_size=6),
    wrong=st.integers(-HOUR, HOUR),
    delay_us=st.integers(0, 100_000),
)
def test_one_wrong_clock_never_makes_anybody_early_and_stops_nobody(
    goods: list[int], wrong: int, delay_us: int
) -> None:
    clocks = [*goods, wrong]
    believed = []
    for number, mine in enumerate(clocks):
        found = Clock(mine)
        found.hear(*clocks[:number], *clocks[number + 1 :], delay_us=delay_us)
        if found.clock.is_believed:
            believed.append(mine)
    assert believed, "somebody always is"
    assert max(believed) <= max(goods) + TOLERANCE_US
    if len(goods) > 1 and abs(wrong) <= TOLERANCE_US - 500_000:
        assert believed == clocks
    if len(goods) > 2:
        assert set(goods) <= set(believed)
