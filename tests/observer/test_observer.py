"""An observer follows a team without taking part, and keeps the record of its run."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import MessageKind, encode
from mrbt_mesh.observer.headline import headline
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.summary import run_summary
from mrbt_mesh.observer.work_log import WorkEnd
from tests.support.script import Script
from tests.support.watched import COVER, WELD, watched

UNSEEN = [line for line in COVER if line != "observe"]


def summary(script: Script, observer: Observer) -> dict[str, Any]:
    return run_summary(observer, "success", script.team.now_us)


def test_an_observer_comes_to_the_same_plan_as_the_robots() -> None:
    script, observer = watched(COVER, "succeed A", "pass 500")
    plan = script.team.processes["A"].agent.view.plan
    assert plan is not None
    assert observer.plan is not None
    assert observer.plan.packed == plan.packed
    assert observer.agreement
    assert observer.robots() == ["A", "B", "C"]


def test_robots_do_not_notice_an_observer() -> None:
    unseen = Script()
    unseen.block([*UNSEEN, "kill A", "pass 900"])
    seen, _ = watched(COVER, "kill A", "pass 900")
    assert seen.team.story == unseen.team.story


def test_a_kill_and_the_takeover_are_recorded() -> None:
    script, observer = watched(COVER, "kill A", "pass 100")
    (takeover,) = summary(script, observer)["takeovers"]
    assert takeover == {
        "robot": "A",
        "at_s": takeover["at_s"],
        "detected_s": takeover["detected_s"],
        "reassigned_s": takeover["reassigned_s"],
        "exact": False,
        "held": "weld",
        "replacement": "B",
    }
    assert 0 <= takeover["detected_s"] <= takeover["reassigned_s"] < 0.2
    assert observer.robot_state("A") is State.DEAD
    assert summary(script, observer)["robots"]["A"]["state"] == "dead"


def test_a_blocked_request_is_an_episode_with_its_reason() -> None:
    script, observer = watched(
        COVER, "succeed A", "kill B", "pass 1500", "start B", "pass 1500", "succeed A", "succeed B"
    )
    script.block(["pass 200"])
    (episode,) = summary(script, observer)["blocked"]
    assert episode["request"] == "cover"
    assert episode["reason"] == "blocked: lift needs 2, 1 alive"
    assert 0 < episode["from"] < episode["to"]
    assert observer.team_result is Status.SUCCESS


def test_the_result_is_the_teams_and_says_who_took_part() -> None:
    script, observer = watched(COVER, "succeed A")
    assert observer.team_result is None
    script.block(["succeed A", "succeed B", "pass 200"])
    assert observer.team_result is Status.SUCCESS
    tasks = summary(script, observer)["global_tasks"]
    assert tasks == {
        "cover": {"status": "success", "robots": ["A", "B"]},
        "weld": {"status": "success", "robots": ["A"]},
    }


def test_what_a_robot_does_worse_is_told_with_the_time() -> None:
    script, observer = watched(COVER, "tell A perform weld=0.25", "pass 100")
    assert summary(script, observer)["robots"]["A"]["performances"] == {"weld": 0.25}
    assert summary(script, observer)["faults"] == []
    assert "A: weld at 0.25" in [text for _, text in observer.record.timeline]
    script.block(["tell A perform weld=0", "pass 300", "tell A perform weld=1", "pass 100"])
    (fault,) = summary(script, observer)["faults"]
    assert (fault["kind"], fault["robot"], fault["local_tasks"]) == ("minor", "A", ["weld"])
    assert round(fault["until_s"] - fault["at_s"], 6) == 0.3
    assert summary(script, observer)["robots"]["A"]["performances"] == {}
    assert "A: weld at 1" in [text for _, text in observer.record.timeline]


def test_a_robot_that_left_is_no_fault() -> None:
    script, observer = watched(COVER, "leave C", "pass 3000")
    assert observer.robot_state("C") is State.LEFT
    assert summary(script, observer)["faults"] == []


def test_claims_of_the_living_are_shown() -> None:
    script, observer = watched(COVER)
    claim = observer.claim("A")
    assert claim is not None
    assert claim.local_task == "weld"
    assert observer.claim("B") is None
    script.block(["kill A", "pass 100"])
    assert observer.claim("A") is None


def test_a_late_observer_of_a_finished_mission_reports_nothing_as_blocked() -> None:
    """Nor that the mission has ended, which is a fact, until it has the facts."""
    script = Script()
    script.block(UNSEEN)
    script.block(["succeed A", "pass 100", "succeed A", "succeed B", "pass 500"])
    script.block(["observe", "pass 500"])
    observer = script.team.observer
    assert observer is not None
    assert not observer.caught_up
    assert observer.team_result is None
    assert observer.record.blocked == []
    observer.read(script.team.processes["A"].agent.view.facts.map, script.team.now_us)
    assert observer.team_result is Status.SUCCESS


def test_who_watches_another_run_is_told_so_once_per_robot() -> None:
    script, observer = watched(COVER)
    stranger = Observer(observer.mission, "another", Timing(), min_cost_flow)
    message = encode(observer.replica.header, MessageKind.FACT, [])
    for _ in range(3):
        stranger.message(MessageKind.FACT, "A", message, script.team.now_us)
        stranger.message(MessageKind.FACT, "A", b"noise", script.team.now_us)
    assert [text for _, text in stranger.record.timeline] == [
        f"A is not of this run: run {observer.replica.header.run!r} (ours is 'another')"
    ]
    assert run_summary(stranger, "timeout", script.team.now_us)["duration_s"] is None


def test_noise_is_noted_and_harms_nothing() -> None:
    script, observer = watched(COVER)
    before = observer.facts.map.digest()
    for kind in ("beat", "fact"):
        observer.message(kind, "Z", b"noise", script.team.now_us)  # type: ignore[arg-type]
    observer.state("Z", b"noise", script.team.now_us)
    assert "not" in observer.refused["Z"]
    assert observer.facts.map.digest() == before


def test_a_run_that_ends_before_its_team_has_gathered_has_not_started() -> None:
    """Whatever was seen by then: no robot, one that looks for the others, or that one's end."""
    _, seen = watched(COVER)
    observer = Observer(seen.mission, seen.facts.run, Timing(), min_cost_flow)
    assert observer.result(anybody_lives=True) == "not_started"
    script = Script()
    script.block([*COVER[:-2], "start A", "pass 200"])
    alone = script.team.observer
    assert alone is not None
    assert alone.robots() == ["A"], "heard, and still waiting for B and C"
    for lives in (True, False):
        assert alone.result(anybody_lives=lives) == "not_started"
    alone.read((), script.team.now_us)
    assert alone.result(anybody_lives=False) == "not_started", "the journals were empty"


@pytest.mark.parametrize(
    ("steps", "anybody_lives", "result"),
    [
        ((), True, "timeout"),
        ((), False, "blocked"),
        (("succeed A", "kill B", "pass 1500"), True, "blocked"),
        (("succeed A", "kill B", "pass 1500", "start B", "pass 1500"), True, "timeout"),
    ],
)
def test_a_run_that_ends_on_its_way_is_blocked_where_nobody_can_go_on(
    steps: tuple[str, ...], anybody_lives: bool, result: str
) -> None:
    assert watched(COVER, *steps)[1].result(anybody_lives) == result


@pytest.mark.parametrize(
    ("steps", "result"),
    [
        (("succeed A", "pass 100", "succeed A", "succeed B"), "success"),
        (("fail A", "pass 100", "fail B"), "failure"),
        (("succeed A",), "blocked"),
    ],
)
def test_what_a_team_left_behind_tells_the_result_of_a_run_that_nobody_saw(
    steps: tuple[str, ...], result: str
) -> None:
    script, seen = watched(COVER, *steps, "pass 1000")
    left_behind = list(script.team.processes["A"].agent.view.facts.map)
    observer = Observer(seen.mission, seen.facts.run, seen.membership.timing, min_cost_flow)
    observer.read(left_behind, 5)
    assert observer.result(anybody_lives=False) == result
    told, expected = (run_summary(o, result, 5)["global_tasks"] for o in (observer, seen))
    assert told["weld"] == expected["weld"]
    assert told["cover"]["status"] == expected["cover"]["status"]


def test_who_comes_late_goes_on_with_what_it_was_told() -> None:
    """Robots that are heard again are the same, and their work has never ended."""
    script, observer = watched(WELD)
    before_us = script.team.now_us
    observer.watch_from(before_us, before_us)
    script.block(["pass 3000"])
    record = observer.record
    assert record.major == []
    assert [(span.robot, span.ended_us) for span in record.work_log.spans] == [("A", None)]
    assert [text for _, text in record.timeline].count("A joined") == 1
    assert record.unwatched == [(before_us, before_us)]
    assert not record.is_catching_up
    script.block(["succeed A", "pass 300"])
    assert record.timeline[-1][1] == "mission: success"


def test_who_is_not_heard_again_has_died_while_nobody_watched() -> None:
    script, observer = watched(WELD)
    record, now_us = observer.record, script.team.now_us
    record.watched_from(now_us + 500_000, now_us)
    record.robot_seen("B", record.robots["B"]["incarnation"], now_us + 600_000)
    record.missed(now_us + 2_000_000)
    (fault,) = record.major
    assert (fault.robot, fault.at_us, fault.is_older) == ("A", now_us, True)
    assert record.work_log.spans[0].end is WorkEnd.DIED
    record.missed(now_us + 3_000_000)
    assert len(record.major) == 1


def test_a_death_before_anybody_watched_has_no_time() -> None:
    """It is known from the others, and the robot from its facts alone."""
    script, watching = watched(WELD, "kill A", "pass 1500")
    incarnation = watching.record.robots["A"]["incarnation"]
    late = Observer(script.mission(), watching.facts.run, Timing(), min_cost_flow)
    late.watch_from(script.team.now_us, 0)
    late.record.is_catching_up = False
    for entry in watching.facts.map:
        late.record.fact(entry, script.team.now_us)
    late.record.declared_dead("A", incarnation, script.team.now_us)
    (fault,) = late.record.major
    assert (fault.robot, fault.is_older) == ("A", True)
    assert ("A is dead (earlier)") in [text for _, text in late.record.timeline]
    assert not late.record.is_catching_up


def test_a_dead_robot_that_is_heard_again_is_back() -> None:
    script, observer = watched(WELD, "kill A", "pass 1500")
    record, now_us = observer.record, script.team.now_us
    (fault,) = record.major
    record.watched_from(now_us, now_us)
    record.robot_seen("A", record.robots["A"]["incarnation"], now_us)
    assert fault.until_us == now_us


def dead_robots(observer: Observer) -> set[str]:
    return {fault.robot for fault in observer.record.major if fault.until_us is None}


@pytest.mark.parametrize("frozen", [("A", "B", "C"), ("A", "B"), ("C",)])
def test_robots_that_all_were_frozen_and_are_back_are_not_dead(frozen: tuple[str, ...]) -> None:
    """Of all of them nobody else has said that they were dead, and nobody takes that back."""
    script, observer = watched(COVER, *(f"freeze {robot}" for robot in frozen), "pass 5000")
    assert dead_robots(observer) == set(frozen)
    script.block([*(f"thaw {robot}" for robot in frozen), "pass 3000"])
    assert dead_robots(observer) == set()
    assert not any("dead" in each.text for each in headline(observer, (), script.team.now_us))
    script.block(["kill C", "pass 3000"])
    assert dead_robots(observer) == {"C"}


TRIO = st.sets(st.sampled_from("ABC"), min_size=1)
SILENCES = st.tuples(TRIO, st.sampled_from([500, 1_500, 3_000, 6_000]), st.booleans())


@given(st.lists(SILENCES, min_size=1, max_size=4), st.sampled_from(["", "A", "B", "C"]))
def test_all_observers_old_and_new_know_who_is_dead(
    silences: list[tuple[set[str], int, bool]], killed: str
) -> None:
    """Whichever robots are frozen together and thaw."""
    script, _ = watched(COVER)
    for frozen, for_ms, is_watched_anew in silences:
        names = sorted(frozen)
        script.block([f"freeze {robot}" for robot in names])
        script.block(["observe"] * is_watched_anew + [f"pass {for_ms}"])
        script.block([*(f"thaw {robot}" for robot in names), "pass 700"])
    script.block(["pass 3000", *([f"kill {killed}"] if killed else []), "pass 3000"])
    for observer in script.team.observers:
        assert dead_robots(observer) == {killed} - {""}


def test_who_comes_late_without_a_word_of_the_past_knows_that() -> None:
    """What is heard until it has caught up may be of any age."""
    script, _ = watched(WELD, "pass 1000")
    script.block(["observe", "pass 1000"])
    late = script.team.observer
    assert late is not None
    ((from_us, to_us),) = late.record.unwatched
    assert from_us is None
    assert to_us == late.record.started_us
    joined = [text for _, text in late.record.timeline if "joined" in text]
    assert joined[0].endswith(" joined (earlier)")
    assert late.record.is_catching_up, "it has not been told the team's facts"


def test_who_watches_from_the_begin_has_missed_nothing() -> None:
    _, observer = watched(WELD)
    assert observer.record.unwatched == []
    assert not observer.record.is_catching_up
