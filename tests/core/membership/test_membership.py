"""Who is alive: silence, lost tokens, relays and suspicions."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.timing import Timing
from tests.support.membership_view import (
    ALIVE,
    DEAD,
    LEFT,
    MS,
    PLAN,
    SUSPECT,
    TIMING,
    View,
    recipients,
)

# -- silence ----------------------------------------------------------------------------------


def test_a_robot_that_misses_beats_is_suspect_and_then_dead() -> None:
    view = View("A", "B", "C")
    view.at(400)
    for robot in "BC":
        view.hear(robot)
    assert view.at(499)["A"] is ALIVE
    assert view.at(500)["A"] is SUSPECT
    view.at(800)
    for robot in "BC":
        view.hear(robot)
    assert view.at(999)["A"] is SUSPECT
    assert view.at(1000)["A"] is DEAD


def test_a_suspect_is_a_member_and_a_dead_robot_is_not() -> None:
    view = View("A", "B")
    assert list(view.at(600).members.members()) == ["A", "B"]
    view.hear("B")
    assert list(view.at(1000).members.members()) == ["B"]


def test_changes_are_told_once_with_what_was_before() -> None:
    view = View("A", "B")
    view.ms = 600
    view.hear("B")
    assert view["A"] is SUSPECT
    assert view.members.detect_failures(600 * MS) == []
    assert view.members.detect_failures(1000 * MS) == [("A", SUSPECT, DEAD)]
    assert view.members.detect_failures(1001 * MS) == []


def test_a_beat_of_the_same_incarnation_revives_a_dead_robot() -> None:
    view = View("A", "B")
    view.ms = 900
    view.hear("B")
    view.at(1200)
    assert view["A"] is DEAD
    view.hear("A")
    assert view["A"] is ALIVE
    assert view.members.members()["A"] == Incarnation(1, "n")


def test_an_old_beat_that_arrives_late_revives_nobody() -> None:
    view = View("A", "B")
    view.hear("A", number=7)
    view.ms = 900
    view.hear("B")
    view.at(1200)
    assert not view.hear("A", number=7)
    assert not view.hear("A", number=5)
    assert view["A"] is DEAD


def test_a_new_incarnation_replaces_the_old_one_and_old_beats_are_ignored() -> None:
    view = View("A")
    assert view.hear("A", life=2, number=1)
    assert view.members.members() == {"A": Incarnation(2, "n")}
    assert not view.hear("A", life=1, number=99)
    assert view.members.members() == {"A": Incarnation(2, "n")}


def test_a_robot_that_has_not_joined_is_known_but_not_counted() -> None:
    view = View()
    view.hear("A", life=0, joined=False)
    assert view["A"] is ALIVE
    assert view.members.members() == {}
    view.hear("A", life=1, joined=True)
    assert list(view.members.members()) == ["A"]


# -- relays -----------------------------------------------------------------------------------


def test_a_relayed_beat_keeps_a_robot_alive_over_a_broken_link() -> None:
    view = View("A", "B")
    for number, ms in enumerate(range(200, 3000, 200), start=2):
        view.ms = ms
        view.hear("B", relays={"A": number})
        assert view["A"] is ALIVE


def test_the_same_relay_again_is_no_news() -> None:
    view = View("A", "B")
    for ms in range(200, 1200, 200):
        view.ms = ms
        view.hear("B", relays={"A": 1})
    assert view["A"] is DEAD


def test_a_relay_revives_a_robot_that_was_thought_dead() -> None:
    view = View("A", "B")
    view.ms = 900
    view.hear("B")
    view.at(1000)
    assert view["A"] is DEAD
    view.hear("B", relays={"A": 2})
    assert view["A"] is ALIVE


def test_robots_relay_only_what_they_hear_and_never_a_suspect() -> None:
    view = View("A", "B")
    assert [(r, w.number) for r, w in view.members.relays().items()] == [("A", 1), ("B", 1)]
    view.at(600)
    view.hear("B")
    assert list(view.members.relays()) == ["B"]


def relays_of(view: View, robot: str) -> dict[str, int]:
    return {name: report.number for name, report in view.members.relays().items() if name == robot}


def test_two_robots_that_relay_one_another_do_not_keep_a_third_alive() -> None:
    here, there = View("A", "P"), View("A", "P")
    for ms in range(100, 1300, 100):
        here.ms = there.ms = ms
        here.hear("P", relays=relays_of(there, "A"))
        there.hear("P", relays=relays_of(here, "A"))
    assert (here["A"], there["A"]) == (DEAD, DEAD)


def test_a_relay_of_oneself_is_ignored() -> None:
    view = View("B")
    view.hear("B", relays={"M": 9})
    assert "M" not in view.members.peers


# -- liveliness tokens ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("others", "steps", "state"),
    [
        ("ABC", "-A", SUSPECT),
        ("ABC", "-A B>A", SUSPECT),
        ("ABC", "-A B>A C>A", DEAD),
        ("AB", "B>A", ALIVE),
        ("AB", "B>A -A", DEAD),
        ("AB", "-A +A B>A", SUSPECT),
        ("AB", "-A A", ALIVE),
        ("AB", "-A A B>A", ALIVE),
        ("ABC", "B>A B -A C>A", SUSPECT),
    ],
)
def test_a_robot_is_dead_once_all_others_have_lost_its_token(
    others: str, steps: str, state: State
) -> None:
    """-A: its token is lost here, +A: it is back; B>A: B reports that too; A: a heartbeat of it."""
    view = View(*others)
    for step in steps.split():
        if step == "-A":
            view.lose_token("A")
        elif step == "+A":
            view.members.receive_token("A", Incarnation(1, "n"), True)
        else:
            robot, _, suspect = step.partition(">")
            view.hear(robot, **({"lost_token": suspect} if suspect else {}))
    assert view["A"] is state


def test_a_token_that_only_this_robot_lost_proves_nothing() -> None:
    view = View("A", "B", "C")
    view.lose_token("A")
    for ms in range(100, 900, 100):
        view.ms = ms
        view.hear("B", lost_token="A")
        view.hear("C", relays={"A": ms})
    assert view["A"] is SUSPECT


def test_only_witnesses_in_good_standing_are_waited_for() -> None:
    view = View("A", "B", "C", "D")
    view.hear("D", joined=False, life=2)
    view.ms = 600
    view.hear("A")
    view.hear("B")
    view.hear("D", joined=False, life=2)
    assert view["C"] is SUSPECT
    view.lose_token("A")
    view.hear("B", lost_token="A")
    assert view["A"] is DEAD


def test_without_any_witness_a_lost_token_kills_nobody() -> None:
    view = View("A")
    view.lose_token("A")
    assert view.at(999)["A"] is SUSPECT
    assert view.at(1000)["A"] is DEAD


def test_the_token_of_an_earlier_incarnation_means_nothing() -> None:
    view = View("A", "B")
    view.hear("A", life=2, number=1)
    view.lose_token("A", life=1)
    view.hear("B", lost_token="A")
    assert view["A"] is ALIVE


# -- everybody at once ------------------------------------------------------------------------


def test_when_most_peers_vanish_together_their_death_waits_one_more_detection_time() -> None:
    view = View("A", "B", "C")
    assert view.at(1000).states("ABC") == [SUSPECT] * 3
    assert view.at(1999).states("ABC") == [SUSPECT] * 3
    assert view.at(2000).states("ABC") == [DEAD] * 3


@pytest.mark.parametrize(("silent", "heard"), [("AB", "CD"), ("A", "")])
def test_half_of_the_peers_or_a_single_one_are_not_most_of_them(silent: str, heard: str) -> None:
    view = View(*silent, *heard)
    view.ms = 900
    for robot in heard:
        view.hear(robot)
    assert view.at(1000).states(silent) == [DEAD] * len(silent)


def test_the_declaration_does_not_depend_on_the_order_of_the_names() -> None:
    view = View("A", "B", "C")
    view.ms = 900
    view.hear("B")
    assert view.at(1000).states("ABC") == [SUSPECT, ALIVE, SUSPECT]
    view.ms = 1800
    view.hear("B")
    assert view.at(1999).states("ABC") == [SUSPECT, ALIVE, SUSPECT]
    assert view.at(2000).states("ABC") == [DEAD, ALIVE, DEAD]


# -- leaving, being slow ----------------------------------------------------------------------


def test_a_robot_that_leaves_is_gone_at_once_and_not_dead_later() -> None:
    view = View("A", "B")
    view.hear("A", leaving=True)
    assert view["A"] is LEFT
    assert list(view.members.members()) == ["B"]
    view.ms = 900
    view.hear("B")
    assert view.at(3000)["A"] is LEFT


def test_a_robot_that_left_may_come_back_with_a_new_incarnation() -> None:
    view = View("A")
    view.hear("A", leaving=True)
    view.hear("A", life=2, number=1)
    assert view["A"] is ALIVE


def test_a_robot_that_was_slow_itself_blames_nobody_for_that_time() -> None:
    view = View("A", "B")
    view.ms = 300
    view.hear("B")
    view.members.allow_for_own_lag(2_000 * MS, 2_500 * MS)
    assert view.at(2500).states("AB") == [SUSPECT, ALIVE]
    assert view.at(2999)["A"] is SUSPECT
    view.hear("B")
    assert view.at(3000)["A"] is DEAD


def test_being_slow_moves_no_evidence_into_the_future() -> None:
    view = View("A")
    view.members.allow_for_own_lag(5_000 * MS, 1_000 * MS)
    assert view.at(1499)["A"] is ALIVE
    assert view.at(1500)["A"] is SUSPECT


# -- what is told to others -------------------------------------------------------------------


def test_a_heartbeat_names_suspects_and_the_dead() -> None:
    view = View("A", "B", "C", "D")
    view.ms = 400
    for robot in "BCD":
        view.hear(robot)
    view.lose_token("B")
    view.at(600)
    told = [(a.robot, a.is_token_lost, a.is_dead) for a in view.members.suspicions()]
    assert told == [("A", False, False), ("B", True, False)]
    view.ms = 800
    view.hear("C")
    view.hear("D")
    view.at(1000)
    told = [(a.robot, a.is_token_lost, a.is_dead) for a in view.members.suspicions()]
    assert told == [("A", False, True), ("B", True, False)]


def test_suspects_are_left_out_when_agreement_is_counted() -> None:
    view = View("A", "B")
    assert view.members.all_report_plan(PLAN)
    view.hear("A", plan=b"another!")
    assert not view.members.all_report_plan(PLAN)
    view.ms = 600
    view.hear("B")
    assert view["A"] is SUSPECT
    assert view.members.all_report_plan(PLAN)


def test_a_newcomer_that_is_still_joining_is_waited_for() -> None:
    view = View("A")
    view.hear("B", life=0, joined=False)
    assert not view.members.all_report_plan(PLAN)


def test_the_mission_is_over_once_everybody_alive_says_so_suspects_included() -> None:
    view = View("A", "B")
    view.hear("A", result=Status.SUCCESS)
    assert not view.members.all_report_result(Status.SUCCESS)
    view.ms = 600
    view.hear("A", result=Status.SUCCESS)
    assert view["B"] is SUSPECT
    assert not view.members.all_report_result(Status.SUCCESS)
    view.ms = 1000
    view.hear("A", result=Status.SUCCESS)
    assert view["B"] is DEAD
    assert view.members.all_report_result(Status.SUCCESS)


def test_a_relayed_plan_and_result_count_like_those_that_were_heard() -> None:
    view = View("A", "B")
    view.hear("A", plan=b"another!")
    view.hear("B", result=Status.SUCCESS, relays={"A": 3})
    assert view.members.all_report_plan(PLAN)
    assert view.members.all_report_result(Status.SUCCESS)


# -- deadlines --------------------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.sampled_from("ABC"), st.integers(0, 700)), max_size=10),
    st.integers(1, 3000),
)
def test_nothing_changes_before_the_next_deadline(beats: list[tuple[str, int]], wait: int) -> None:
    view = View("A", "B", "C")
    for robot, pause in beats:
        view.ms += pause
        view.hear(robot)
    now_us = view.ms * MS
    view.members.detect_failures(now_us)
    deadline_us = view.members.next_detection_us
    then_us = now_us + wait * MS
    changed = view.members.detect_failures(then_us)
    if changed:
        assert now_us < deadline_us <= then_us


@pytest.mark.parametrize(("beat", "detection"), [(400, 1000), (0, 1000), (334, 1000)])
def test_a_detection_time_of_less_than_three_beats_is_refused(beat: int, detection: int) -> None:
    with pytest.raises(ValueError, match="at least 3 beat periods"):
        Timing(beat * MS, detection * MS)


def test_what_follows_from_beat_and_detection_time() -> None:
    assert (TIMING.silence_limit_us(0), TIMING.grace_us) == (1_000 * MS, 300 * MS)
    assert TIMING.fence_us == min(TIMING.silence_limit_us(silence) for silence in range(1_001))
    assert all(0 < offset < TIMING.heartbeat_us for offset in TIMING.repeat_offsets_us())


def test_who_suspects_this_robot_hears_from_it_although_it_is_no_neighbour() -> None:
    """Two robots may see different rings, and only one of them the other as its neighbour."""
    names = [f"R{number}" for number in range(16)]
    view = View(*names)
    around = view.members.around
    recipients(around, 1)
    suspecting = next(robot for robot in names if robot not in around.near())
    for number in range(2, 22):
        view.hear(suspecting, probes=["M"])
        assert suspecting in (recipients(around, number) or ())
