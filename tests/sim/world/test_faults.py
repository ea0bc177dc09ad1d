"""The team carries on: robots die, freeze, leave and return; the network loses and cuts."""

from __future__ import annotations

import random

import pytest

from mrbt_mesh.drills.physical import of, spans
from mrbt_mesh.sim import (
    Block,
    Fault,
    Freeze,
    Garbage,
    Kill,
    Leave,
    LinkKnobs,
    Lose,
    LoseToken,
    NetworkKnobs,
    Restart,
    Restore,
    Thaw,
    Unblock,
    partition,
)
from mrbt_mesh.sim.world.faults import Operate
from tests.support.effort import seeds
from tests.support.runs import Run, undisturbed

SECOND_US = 1_000_000
ROBOTS = ["A1", "A2", "B1", "B2", "C1", "C2"]
SPEED = 4.0
LENGTH_US = 6_200_000  # of a run at SPEED
ROUGH = LinkKnobs(
    delay_us=2_000,
    jitter_us=5_000,
    loss_permille=200,
    duplicate_permille=100,
    reorder_permille=200,
)


@pytest.mark.parametrize("seed", seeds(5))
def test_without_faults_all_stop_by_themselves_and_nothing_is_reported(run: Run, seed: int) -> None:
    result = run("vehicle_repair", seed)
    assert (
        result.summary["faults"] == result.summary["blocked"] == result.summary["takeovers"] == []
    )
    assert result.stops == dict.fromkeys(ROBOTS, (0, "mission success"))
    assert 23 < result.summary["duration_s"] < 25


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["A1", "A2", "B1", "B2"])
@pytest.mark.parametrize("seed", seeds(10))
def test_any_a_or_b_may_be_killed_at_any_moment(run: Run, robot: str, seed: int) -> None:
    at_us = random.Random(f"{robot}/{seed}").randrange(LENGTH_US)
    result = run("vehicle_repair", seed, schedule=[(at_us, Kill(robot))], speed=SPEED)
    assert not any(event["t"] > at_us / 1e6 and event["robot"] == robot for event in result.events)


@pytest.mark.parametrize("seed", seeds(8))
def test_both_a_and_one_b_may_be_killed_one_after_another(run: Run, seed: int) -> None:
    choose = random.Random(seed)
    victims = ["A1", "A2", choose.choice(["B1", "B2"])]
    choose.shuffle(victims)
    schedule = [(choose.randrange(LENGTH_US), Kill(robot)) for robot in victims]
    run("vehicle_repair", seed, schedule=schedule, speed=SPEED)


def test_an_a_killed_while_it_replaces_hardware_is_replaced_by_a_b_at_once(run: Run) -> None:
    before = of(undisturbed(3), "replace_hw")[0]
    at_us = round((before.start_s + 0.7) * 1e6)
    result = run("vehicle_repair", 3, schedule=[(at_us, Kill(before.robot))])
    dead, replacement = of(spans(result.events), "replace_hw", before.part)
    assert (dead.robot, dead.end) == (before.robot, None)
    assert (replacement.robot[0], replacement.end) == ("B", "success")
    assert replacement.activation == dead.activation
    assert replacement.start_s - at_us / 1e6 < 0.05
    (takeover,) = result.summary["takeovers"]
    assert takeover["robot"] == dead.robot
    assert takeover["replacement"] == replacement.robot
    assert 0 < takeover["detected_s"] < takeover["reassigned_s"] < 0.05


def test_without_tokens_a_death_is_found_within_the_detection_time(run: Run) -> None:
    before = of(undisturbed(3), "replace_hw")[0]
    at_us = round((before.start_s + 0.5) * 1e6)
    network = NetworkKnobs(token_delay_us=None)
    schedule = [(at_us, Kill(before.robot))]
    result = run("vehicle_repair", 3, schedule=schedule, network=network)
    _, replacement = of(spans(result.events), "replace_hw", before.part)
    assert 0.5 < replacement.start_s - at_us / 1e6 < 1.5


def test_a_c_killed_early_blocks_the_mission_until_it_is_back(run: Run) -> None:
    schedule: list[tuple[int, Fault]] = [(SECOND_US, Kill("C1"))]
    blocked = run("vehicle_repair", 1, schedule=schedule, expect="blocked", timeout_us=9_000_000)
    (episode,) = blocked.summary["blocked"]
    assert episode["request"] == "remove_cover"
    assert episode["reason"] == "blocked: move_frame needs 2, 1 alive"
    assert episode["to"] is None

    schedule.append((9 * SECOND_US, Restart("C1")))
    result = run("vehicle_repair", 1, schedule=schedule)
    (episode,) = result.summary["blocked"]
    assert episode["reason"] == "blocked: move_frame needs 2, 1 alive"
    assert 9 < episode["to"] < 10.5
    (fault,) = result.summary["faults"]
    assert (fault["robot"], fault["kind"]) == ("C1", "major")
    assert fault["until_s"] == pytest.approx(episode["to"], abs=0.5)


@pytest.mark.parametrize("seed", seeds(4))
def test_a_c_killed_later_blocks_the_cover_only(run: Run, seed: int) -> None:
    schedule = [(10 * SECOND_US, Kill("C2")), (30 * SECOND_US, Restart("C2"))]
    result = run("vehicle_repair", seed, schedule=schedule)
    (episode,) = result.summary["blocked"]
    assert episode["request"] == "place_cover"
    assert max(s.end_s for s in of(spans(result.events), "use_soldering_iron")) < 25


def test_a_frozen_robot_is_replaced_and_yields_when_it_thaws(run: Run) -> None:
    before = of(undisturbed(2), "replace_hw")[0]
    robot, frozen_us = before.robot, round((before.start_s + 1.0) * 1e6)
    thawed_us = frozen_us + 4 * SECOND_US
    schedule = [(frozen_us, Freeze(robot)), (thawed_us, Thaw(robot))]
    result = run("vehicle_repair", 2, schedule=schedule)
    own, other = of(spans(result.events), "replace_hw", before.part)
    # It would have been done a second later, but it was frozen: it must not finish on waking.
    assert (own.robot, own.end) == (robot, "cancel")
    assert own.end_s == pytest.approx(thawed_us / 1e6, abs=1e-6)
    assert other.end == "success"
    assert other.robot != robot
    assert other.start_s - frozen_us / 1e6 < 1.5
    later = [s for s in spans(result.events) if s.robot == robot and s.start_s > own.end_s]
    assert all(s.incarnation != own.incarnation for s in later)


def test_a_short_freeze_is_no_fault(run: Run) -> None:
    before = of(undisturbed(2), "replace_hw")[0]
    robot, frozen_us = before.robot, round((before.start_s + 1.7) * 1e6)
    schedule = [(frozen_us, Freeze(robot)), (frozen_us + 600_000, Thaw(robot))]
    result = run("vehicle_repair", 2, schedule=schedule)
    (own,) = of(spans(result.events), "replace_hw", before.part)
    assert own.end == "success"
    # The work was due while it was frozen; its next steps follow from when it woke.
    assert own.end_s >= (frozen_us + 600_000) / 1e6
    assert result.summary["faults"] == []


@pytest.mark.parametrize("seed", seeds(6))
def test_messages_are_lost_doubled_and_overtaken(run: Run, seed: int) -> None:
    run("vehicle_repair", seed, network=NetworkKnobs(ROUGH))


def test_after_losses_all_come_to_the_same_facts_and_rest(run: Run) -> None:
    """I2 on a mission that is blocked, so that the end is quiet."""
    network = NetworkKnobs(ROUGH, quiet_from_us=8 * SECOND_US)
    schedule = [(SECOND_US, Kill("C1"))]
    result = run(
        "vehicle_repair",
        5,
        schedule=schedule,
        network=network,
        expect="blocked",
        timeout_us=20_000_000,
    )
    living = [agent for robot, agent in result.agents.items() if robot != "C1"]
    assert len({agent.view.facts.map.digest() for agent in living}) == 1
    assert len({agent.view.plan.packed for agent in living if agent.view.plan}) == 1
    assert {"I1", "I2", "I3", "I4"} <= result.checks.keys()


@pytest.mark.parametrize("seed", seeds(8))
def test_a_partition_heals(run: Run, seed: int) -> None:
    choose = random.Random(seed)
    left = choose.sample(ROBOTS, choose.randint(1, 5))
    right = [robot for robot in ROBOTS if robot not in left]
    start_us = choose.randrange(18 * SECOND_US)
    schedule = [(start_us, partition(left, right)), (start_us + 3 * SECOND_US, Unblock())]
    run("vehicle_repair", seed, schedule=schedule)


def test_robots_that_are_cut_off_at_the_end_do_not_hold_up_the_run(run: Run) -> None:
    schedule = [(23 * SECOND_US, partition(["A1", "B2"], ["A2", "B1", "C1", "C2"]))]
    result = run("vehicle_repair", 7, schedule=schedule)
    assert result.stops.keys() == {"A2", "B1", "C1", "C2"}
    assert result.summary["duration_s"] < 26


def test_one_broken_link_kills_nobody(run: Run) -> None:
    link = Block(frozenset({("A1", "B1"), ("B1", "A1")}))
    result = run("vehicle_repair", 1, schedule=[(SECOND_US, link)], keep_log=True)
    assert result.summary["faults"] == []
    assert not any("robot_dead" in line for line in result.effect_log)


@pytest.mark.parametrize("seed", seeds(5))
def test_tokens_that_lie_kill_nobody(run: Run, seed: int) -> None:
    choose = random.Random(seed)
    schedule = [
        (choose.randrange(LENGTH_US), LoseToken(*choose.sample(ROBOTS, 2))) for _ in range(10)
    ]
    result = run("vehicle_repair", seed, schedule=schedule, speed=SPEED, keep_log=True)
    assert result.summary["faults"] == []
    assert not any("robot_dead" in line for line in result.effect_log)


@pytest.mark.parametrize("seed", seeds(5))
def test_garbage_changes_nothing(run: Run, seed: int) -> None:
    """I8: the robots do the same things at the same times as without it."""
    schedule = [(at_us, Garbage(robot, 40)) for robot in ROBOTS for at_us in (25_000, 999_983)]
    expected = run("vehicle_repair", seed, speed=SPEED)
    result = run("vehicle_repair", seed, schedule=schedule, speed=SPEED)
    assert result.checks["I8"] == len(schedule) * 40
    assert result.events == expected.events
    assert result.summary == expected.summary


def test_a_robot_that_leaves_hands_its_work_over_at_once(run: Run) -> None:
    before = of(undisturbed(3), "replace_hw")[0]
    at_us = round((before.start_s + 0.7) * 1e6)
    result = run("vehicle_repair", 3, schedule=[(at_us, Leave(before.robot))])
    own, other = of(spans(result.events), "replace_hw", before.part)
    assert (own.robot, own.end) == (before.robot, "cancel")
    assert other.start_s - at_us / 1e6 < 0.05
    assert result.summary["faults"] == []
    assert result.summary["robots"][own.robot]["state"] == "left"
    assert result.stops[own.robot] == (0, "left")


def test_a_minor_fault_takes_one_capability_until_it_is_restored(run: Run) -> None:
    before = of(undisturbed(3), "replace_hw")[0]
    robot, at_us = before.robot, round((before.start_s + 0.7) * 1e6)
    schedule = [(at_us, Lose(robot, "replace_hw")), (at_us + 3 * SECOND_US, Restore(robot))]
    result = run("vehicle_repair", 3, schedule=schedule)
    own, other = of(spans(result.events), "replace_hw", before.part)
    assert (own.end, other.end) == ("cancel", "success")
    assert other.robot != robot
    (fault,) = result.summary["faults"]
    assert (fault["kind"], fault["robot"], fault["local_tasks"]) == ("minor", robot, ["replace_hw"])
    assert fault["until_s"] - fault["at_s"] == pytest.approx(3, abs=0.01)
    assert of(spans(result.events), "replace_wires"), "it still does the rest"


def test_the_operator_pauses_resumes_and_aborts(run: Run) -> None:
    pause = [(SECOND_US, Operate("A1", "paused", "pause"))]
    paused = run("vehicle_repair", 1, schedule=pause, expect="timeout", timeout_us=5_000_000)
    assert {span.end for span in spans(paused.events)} == {"cancel"}
    resume = [*pause, (5 * SECOND_US, Operate("B2", "paused", "resume"))]
    run("vehicle_repair", 1, schedule=resume)
    abort = [(4 * SECOND_US, Operate("C2", "aborted", True))]
    aborted = run("vehicle_repair", 1, schedule=abort, expect="failure")
    assert aborted.duration_us < 5 * SECOND_US
