"""How long a robot may be silent: that follows from how regularly news of it came."""

from __future__ import annotations

from mrbt_mesh.core.facts.store import Incarnation
from tests.support.membership_view import ALIVE, DEAD, MS, SUSPECT, TIMING, View


def test_a_robot_that_is_heard_badly_may_be_silent_for_longer() -> None:
    view = View("A", "B", "C")
    last_ms = {}
    for step in range(120):
        view.ms = 100 * step
        for robot in "ABC" if step % 3 == 0 else "BC":
            view.hear(robot)
            last_ms[robot] = view.ms
    limit_ms = TIMING.silence_limit_us(view.members.peers["A"].arrivals.overdue_permille) // MS
    assert 1_500 < limit_ms <= 3_000
    for ms in range(view.ms, last_ms["A"] + limit_ms, 100):
        view.ms = ms
        view.hear("B")
        view.hear("C")
        assert view["A"] is (SUSPECT if ms >= last_ms["A"] + limit_ms // 2 else ALIVE)
    view.ms = last_ms["A"] + limit_ms
    view.hear("B")
    assert view["A"] is DEAD


def test_a_new_life_is_heard_over_the_same_network() -> None:
    view = View("A", "B")
    history = view.members.peers["A"].arrivals
    view.hear("A", life=2, number=1)
    assert view.members.peers["A"].arrivals is history


def test_an_outage_that_ended_in_a_declaration_is_no_measure_of_the_network() -> None:
    view = View("A", "B")
    view.ms = 900
    view.hear("B")
    before = view.members.peers["A"].arrivals.observed_us
    view.at(1_000)
    view.ms = 9_000
    view.hear("A")
    assert view["A"] is ALIVE
    assert view.members.peers["A"].arrivals.observed_us == before


def test_a_declaration_follows_that_of_another_robot_if_there_was_silence_here_as_well() -> None:
    view = View("A", "B", "C")
    for _ in range(40):
        view.ms += 300  # two beats of three are lost
        for robot in "ABC":
            view.hear(robot)
    start_ms = view.ms
    assert view.members.peers["A"].silence_limit_us > 2_000 * MS
    for ms in range(200, 1_600, 200):
        view.ms = start_ms + ms
        view.hear("C")
        view.hear("B", declares_dead="A")
        assert view["A"] is (
            DEAD if ms * MS >= view.members.peers["A"].silence_limit_us // 2 else ALIVE
        )


def test_who_only_watches_believes_the_team_as_long_as_there_is_one() -> None:
    view = View("A", "B", me="")
    for ms in range(100, 2_000, 100):
        view.ms = ms
        view.hear("B")
        assert view["A"] is (SUSPECT if ms >= 500 else ALIVE)
    view.hear("B", declares_dead="A")
    assert view["A"] is DEAD


def test_who_only_watches_finds_out_by_himself_that_all_are_dead() -> None:
    view = View("A", "B", me="")
    assert view.at(400)["A"] is ALIVE
    assert view.at(1_999)["A"] is SUSPECT
    assert {view.at(2_100)[robot] for robot in "AB"} == {DEAD}


def test_a_declaration_of_another_robot_alone_kills_nobody() -> None:
    view = View("A", "B", "C")
    for ms in range(100, 3_000, 100):
        view.ms = ms
        view.hear("A")
        view.hear("B", declares_dead="A")
        assert view["A"] is ALIVE
    view.at(view.ms + 999)
    view.hear("C")
    assert view["A"] is SUSPECT


def test_in_a_large_team_it_is_enough_if_the_token_of_a_neighbour_is_gone_here_as_well() -> None:
    names = [f"R{number}" for number in range(16)]
    view = View(*names)
    gone = min(view.members.around.near())
    accuser = next(robot for robot in names if robot != gone)
    view.hear(accuser, declares_dead=[gone])
    assert view[gone] is ALIVE
    view.lose_token(gone)
    assert view[gone] is DEAD
    assert view.members.around.broadcast_generation == 0, "one has told everybody"


def test_of_neighbours_that_lose_a_token_those_tell_everybody_whom_nobody_has_told() -> None:
    view = View(*(f"R{number}" for number in range(16)))
    around = view.members.around
    gone = min(around.near())
    view.lose_token(gone)
    assert (view[gone], around.broadcast_generation) == (SUSPECT, 0)
    for witness in around.witnesses(gone):
        view.hear(witness, lost_token=[gone])
    assert (view[gone], around.broadcast_generation) == (DEAD, 1)


def test_in_a_small_team_each_hears_of_tokens_itself_and_all_must_have_lost_it() -> None:
    view = View("A", "B", "C")
    view.lose_token("A")
    view.hear("B", declares_dead=["A"])
    assert view["A"] is SUSPECT


def test_half_of_the_limit_without_news_and_a_robot_is_probed() -> None:
    view = View("A", "B")
    view.ms = 499
    view.hear("B")
    assert not view.members.is_probing
    view.at(500)
    assert view.members.is_probing
    assert [(a.robot, a.is_probe) for a in view.members.suspicions()] == [("A", True)]
    view.hear("A")
    assert not view.members.is_probing


def test_the_dead_are_probed_no_more() -> None:
    view = View("A", "B")
    view.ms = 900
    view.hear("B")
    view.at(1_000)
    assert view["A"] is DEAD
    assert not view.members.is_probing
    assert [(a.is_dead, a.is_probe) for a in view.members.suspicions()] == [(True, False)]


def test_a_robot_whose_token_is_lost_but_whose_beats_come_is_not_probed() -> None:
    view = View("A", "B")
    view.lose_token("A")
    assert view["A"] is SUSPECT
    assert not view.members.is_probing


def test_who_has_news_of_a_probed_robot_is_asked_for_it() -> None:
    view = View("A", "B")
    view.hear("B", probes="A")
    assert view.can_answer
    view.hear("B", probes="Z")
    assert not view.can_answer, "of whom it knows nothing"
    view.hear("B", lost_token="A", declares_dead="A")
    assert not view.can_answer, "nobody probes it"
    view.ms = 600
    view.hear("B", probes="A")
    assert view["A"] is SUSPECT
    view.hear("B", probes="A")
    assert not view.can_answer, "it has no news either"


def test_a_robot_that_is_probed_itself_is_asked_if_this_life_of_it_is_meant() -> None:
    view = View("B")
    view.hear("B", probes="M")
    assert not view.can_answer, "an earlier life"
    beat = view.members.peers["B"].heartbeat
    assert beat is not None
    assert view.members.can_answer_probe(beat, Incarnation(1, "n"))
