"""When a newcomer has heard and asked enough."""

from __future__ import annotations

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.joining import JOINS_AT_A_TIME, Joining
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport

MS = 1_000
TIMING = Timing(100 * MS, 1_000 * MS)
MINE, OTHER = b"mine____", b"other___"


class Newcomer:
    """A robot M that joins at time 0 and expects `robots`."""

    def __init__(self, robots: str) -> None:
        self.joining = Joining(TIMING, frozenset(robots), 0)
        self.members = Membership("M", TIMING)
        self.number = 0

    def hear(self, robot: str, digest: bytes = OTHER, ms: int = 0) -> None:
        self.number += 1
        life = Incarnation(1, "n")
        report = SelfReport(life, self.number, b"p" * 8, True, 0)
        beat = Heartbeat(report, False, digest, (0, 0, 0, 0), 0, (), {})
        self.members.receive_heartbeat(robot, beat, ms * MS)
        self.joining.mark_heard(robot)

    def wants(self, ms: int = 0) -> list[str]:
        self.members.detect_failures(ms * MS)
        return self.joining.still_to_ask(self.members.peers, MINE, ms * MS)


def test_everybody_that_is_heard_is_asked() -> None:
    new = Newcomer("AB")
    assert new.wants() == []
    new.hear("B")
    new.hear("A")
    assert new.wants() == ["A", "B"]
    new.joining.mark_answered("A")
    assert new.wants() == ["B"]


def test_an_equal_digest_counts_once_somebody_has_answered() -> None:
    """Before that it may be as old as one's own facts: of the time before a long sleep."""
    new = Newcomer("ABC")
    new.hear("A", MINE)
    new.hear("B", MINE)
    new.hear("C")
    assert new.wants() == ["A", "B", "C"]
    new.joining.mark_answered("A")
    assert new.wants() == ["C"]
    new.hear("C", MINE)
    assert new.wants() == []


def test_the_dead_are_not_asked() -> None:
    new = Newcomer("AB")
    new.hear("A")
    for ms in range(0, 1_100, 100):
        new.hear("B", OTHER, ms)
    assert new.wants(1_000) == ["B"]


def test_who_never_answers_is_waited_for_no_longer_than_the_longest_detection_time() -> None:
    new = Newcomer("AB")
    for ms in range(0, 3_100, 100):
        new.hear("A", OTHER, ms)
        new.hear("B", OTHER, ms)
        assert new.wants(ms) == ["A", "B"], "nobody has answered yet"
    new.joining.mark_answered("B")
    assert new.wants(2_999) == ["A"]
    assert new.wants(3_000) == []


def everybody(robot: str) -> bool:
    return True


def test_all_must_be_there_or_one_detection_time_pass() -> None:
    new = Newcomer("AB")
    new.hear("A")
    assert not new.joining.are_all_there(new.members.peers, everybody)
    assert not new.joining.is_done(False, False, False, 999 * MS)
    assert new.joining.is_done(False, False, False, 1_000 * MS)
    new.hear("B")
    assert new.joining.are_all_there(new.members.peers, everybody)
    assert new.joining.is_done(True, False, False, 10 * MS)
    assert not new.joining.is_done(True, True, False, 10 * MS), "others hear an earlier life"


def test_of_robots_that_are_no_neighbours_it_is_enough_to_know() -> None:
    new = Newcomer("ABC")
    new.hear("A")
    assert not new.joining.are_all_there(new.members.peers, "A".__eq__)
    beside = Joining(TIMING, frozenset("A"), 0)
    assert not beside.are_all_there(new.members.peers, "A".__eq__), "a neighbour has to be heard"
    assert beside.are_all_there(new.members.peers, "B".__eq__)
    new.members.detect_failures(1_000 * MS)
    assert not beside.are_all_there(new.members.peers, "B".__eq__), "it is silent"


def test_a_team_that_gathers_waits_longer_and_a_newcomer_to_one_that_is_there_does_not() -> None:
    joining = Joining(TIMING, frozenset("AB"), 0, gather_us=5_000 * MS)
    joining.mark_heard("A")
    assert not joining.is_done(False, False, False, 4_999 * MS)
    assert joining.is_done(False, False, False, 5_000 * MS)
    assert not joining.is_done(False, False, True, 999 * MS)
    assert joining.is_done(False, False, True, 1_000 * MS)


def test_who_hears_nobody_waits_longer_than_who_misses_some() -> None:
    times: dict[str, int] = {"gather_us": 2_000 * MS, "alone_after_us": 5_000 * MS}
    joining = Joining(TIMING, frozenset("AB"), 0, **times)
    assert joining.expects_others
    assert not joining.is_done(False, False, False, 4_999 * MS)
    assert joining.is_done(False, False, False, 5_000 * MS)
    joining.mark_heard("A")
    assert joining.is_done(False, False, False, 2_000 * MS)


def test_who_is_alone_by_design_does_not_wait() -> None:
    joining = Joining(TIMING, frozenset(), 0, alone_after_us=5_000 * MS)
    assert not joining.expects_others
    assert joining.is_done(True, False, False, 0)


def test_many_newcomers_of_a_large_team_join_a_few_at_a_time() -> None:
    joining = Joining(TIMING, frozenset(), 0)
    assert not joining.yields(JOINS_AT_A_TIME - 1, 0, 0)
    assert joining.yields(JOINS_AT_A_TIME, 0, 0)
    # As long as others join it waits for them, and no longer, whoever dies and comes back.
    assert joining.yields(JOINS_AT_A_TIME, 2, 900 * MS)
    assert joining.yields(JOINS_AT_A_TIME, 1, 1_500 * MS)
    assert joining.yields(JOINS_AT_A_TIME, 2, 1_899 * MS)
    assert joining.yields_until_us == 1_900 * MS
    assert not joining.yields(JOINS_AT_A_TIME, 2, 1_900 * MS)
