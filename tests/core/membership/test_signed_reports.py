"""What one robot says of another counts with that robot's own signature."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.signed_reports import SignedReports, joined_report
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport, Suspicion
from tests.support.keys import keys_of

ROBOTS = ("A", "B", "LIAR")
KEYS = keys_of(*ROBOTS)
RUN, TIMING = "r", Timing()
LIFE = Incarnation(3, "n")
LATER = Incarnation((1 << 53) - 1, "x")


def signer(robot: str, run: str = RUN) -> SignedReports:
    return SignedReports(KEYS[robot], run)


def report(robot: str, number: int, life: Incarnation = LIFE, by: str = "") -> SelfReport:
    """A robot's report, signed by itself or by another robot."""
    plain = SelfReport(life, number, b"12345678", True, 1)
    return signer(by or robot).sign(robot, plain)


def heartbeat(
    robot: str, number: int, relays: dict[str, SelfReport], *suspicions: Suspicion
) -> Heartbeat:
    return Heartbeat(
        report(robot, number), False, bytes(8), (0, 0, 0, 0), 0, tuple(suspicions), relays
    )


class Heard:
    """What the robot B makes of what it hears."""

    def __init__(self) -> None:
        self.members = Membership("B", TIMING, ROBOTS, signer("B"))
        self.ids = DuplicateIdCheck("B", "mine", False, TIMING, signer("B"))
        self.now_us = 0
        self.numbers = dict.fromkeys(ROBOTS, 0)
        self.hear("A")

    def hear(
        self, robot: str, relays: dict[str, SelfReport] | None = None, *suspicions: Suspicion
    ) -> str | None:
        """A robot's own heartbeat; why this process should stop."""
        self.numbers[robot] += 1
        beat = heartbeat(robot, self.numbers[robot], relays or {}, *suspicions)
        self.members.receive_heartbeat(robot, beat, self.now_us)
        return self.ids.check_relays(robot, beat, Incarnation(2, "mine"), False, {}, self.now_us)

    def pass_time(self, us: int, relays: dict[str, SelfReport] | None = None) -> State:
        """The liar goes on, for so long; what is A then?"""
        for _ in range(us // TIMING.heartbeat_us):
            self.now_us += TIMING.heartbeat_us
            self.hear("LIAR", relays)
            self.members.detect_failures(self.now_us)
        return self.members.peers["A"].state


GOOD = report("A", 9)
LIES = {
    "of a later life": replace(GOOD, incarnation=LATER),
    "of a later number": replace(GOOD, number=(1 << 53) - 1),
    "of another plan": replace(GOOD, number=10, plan_digest=b"87654321"),
    "unsigned": replace(GOOD, signature=b""),
    "signed by the liar": report("A", 9, by="LIAR"),
    "of the liar, as of another": report("LIAR", 9),
    "of another run": signer("A", "yesterday").sign("A", replace(GOOD, signature=b"")),
    "with another end": replace(GOOD, result=2),
}


@pytest.mark.parametrize("lie", LIES.values(), ids=LIES)
def test_a_relay_that_its_robot_has_not_signed_changes_nothing(lie: SelfReport) -> None:
    heard = Heard()
    before = heard.members.peers["A"].report
    heard.hear("LIAR", {"A": lie})
    assert heard.members.peers["A"].report == before
    assert heard.members.false_relays == ["A"]
    heard.hear("LIAR", {"A": GOOD})
    assert heard.members.peers["A"].report == GOOD
    assert not heard.members.false_relays


def test_nobody_comes_to_be_by_a_relay_of_a_liar() -> None:
    heard = Heard()
    heard.hear("LIAR", {"C": report("C", 1, by="LIAR")})
    assert "C" not in heard.members.peers


def test_a_dead_robot_is_not_kept_alive() -> None:
    heard = Heard()
    heard.hear("LIAR", {"A": GOOD})
    state = heard.pass_time(TIMING.max_silence_us, {"A": GOOD})
    assert state is State.DEAD
    again = replace(GOOD, number=10)
    assert heard.pass_time(TIMING.heartbeat_us, {"A": again}) is State.DEAD


@pytest.mark.parametrize("by", ["LIAR", "A"])
def test_no_relay_of_another_robot_stops_one(by: str) -> None:
    heard = Heard()
    assert heard.hear("LIAR", {"B": report("B", 1, LATER, by=by)}) is None
    assert "another process" in str(heard.hear("A", {"B": report("B", 1, LATER)}))


def test_no_suspicion_of_a_life_that_never_was_makes_a_robot_join_again() -> None:
    heard = Heard()
    for each in (None, report("B", 1, LATER, by="LIAR")):
        heard.hear("LIAR", {}, Suspicion("B", LATER, False, True, False, each))
        assert heard.ids.other_incarnation == Incarnation(0, "")
    heard.hear("A", {}, Suspicion("B", LATER, False, True, False, report("B", 1, LATER)))
    assert heard.ids.other_incarnation == LATER


def test_a_view_counts_as_far_as_it_is_signed_or_follows_from_facts() -> None:
    members = Membership("B", TIMING, ROBOTS, signer("B"))
    forged = {"A": replace(GOOD, incarnation=LATER), "C": replace(GOOD, signature=b"")}
    members.compare_view("LIAR", forged, {}, 0)
    assert not members.peers
    members.compare_view("LIAR", {"A": GOOD}, {}, 0)
    assert members.peers["A"].report == GOOD
    members.compare_view("LIAR", {"C": replace(GOOD, signature=b"")}, {"C": LIFE}, 0)
    assert members.peers["C"].report == joined_report(LIFE)


def test_what_others_could_not_check_is_not_relayed() -> None:
    members = Membership("B", TIMING, ROBOTS, signer("B"))
    members.compare_view("LIAR", {"A": joined_report(LIFE)}, {"A": LIFE}, 0)
    assert members.relays() == {}
    members.receive_heartbeat("A", heartbeat("A", 1, {}), 0)
    assert members.relays() == {"A": report("A", 1)}


def test_a_robot_whose_key_was_revoked_is_not_relayed() -> None:
    """As long as it is only silent it would live on in what others pass on."""
    members = Membership("B", TIMING, ROBOTS, SignedReports(keys_of("B", "LIAR")["B"], RUN))
    members.receive_heartbeat("LIAR", heartbeat("LIAR", 1, {"A": GOOD}), 0)
    assert "A" not in members.peers
