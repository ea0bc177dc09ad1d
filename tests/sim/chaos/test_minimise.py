"""Cutting down a failing schedule: only what it takes is left, within the budget."""

from __future__ import annotations

import math

import pytest

from mrbt_mesh.sim.chaos.minimise import minimise
from mrbt_mesh.sim.world.faults import (
    Block,
    Disturb,
    Fault,
    Freeze,
    Garbage,
    Heal,
    Kill,
    Lose,
    Thaw,
)
from mrbt_mesh.sim.world.network import LinkKnobs
from mrbt_mesh.sim.world.scenario import USUAL, Scenario

SECOND_US = 1_000_000
NOISE: list[tuple[int, Fault]] = [(1_234_567 * i, Lose(f"R{i}", "all")) for i in range(1, 9)]


def scenario(*steps: tuple[int, Fault]) -> Scenario:
    heal = (20 * SECOND_US, Heal(("R1",)))
    link = LinkKnobs(delay_us=7_000)
    base = Scenario(1, ("R1", "R2"), (), 20 * SECOND_US, 80 * SECOND_US, link, None, stays=True)
    return base.with_steps([*NOISE, *steps, heal])


def has(scenario: Scenario, *faults: Fault) -> bool:
    found = [fault for _, fault in scenario.steps]
    return all(fault in found for fault in faults)


def test_two_of_many_faults_are_left_at_round_times_in_a_plain_world() -> None:
    needed = Kill("R2"), Freeze("R1")
    start = scenario((3_141_592, needed[0]), (5_926_535, needed[1]), (8_000_000, Thaw("R1")))
    found = minimise(start, lambda smaller: has(smaller, *needed), math.inf)
    assert found.is_done
    assert [fault for _, fault in found.scenario.steps] == [*needed, Heal(("R1",))]
    assert [at_us for at_us, _ in found.scenario.steps] == [3_000_000, 5_000_000, 5_100_000]
    assert found.scenario.link == USUAL
    assert found.scenario.token_delay_us == Scenario.token_delay_us
    assert not found.scenario.stays
    assert found.scenario.timeout_us - found.scenario.heal_us == 60 * SECOND_US


def test_what_needs_no_fault_at_all_is_left_with_the_healing_only() -> None:
    found = minimise(scenario(), lambda smaller: True, math.inf)
    assert [type(fault) for _, fault in found.scenario.steps] == [Heal]


def test_order_and_times_that_matter_are_kept() -> None:
    def fails(smaller: Scenario) -> bool:
        times = {fault: at_us for at_us, fault in smaller.steps}
        kill, thaw = times.get(Kill("R2")), times.get(Thaw("R1"))
        return kill is not None and thaw is not None and 40_000 < thaw - kill < 60_000

    start = scenario((3_141_592, Kill("R2")), (3_191_592, Thaw("R1")))
    found = minimise(start, fails, math.inf)
    assert fails(found.scenario)
    assert len(found.scenario.steps) == 3


@pytest.mark.parametrize(
    ("fault", "plain"),
    [
        (Garbage("R1", 20), Garbage("R1", 1)),
        (
            Disturb(LinkKnobs(delay_us=9, loss_permille=300, duplicate_permille=100)),
            Disturb(LinkKnobs(loss_permille=300)),
        ),
        (
            Block(frozenset({("R1", "R2"), ("R2", "R1"), ("R1", "R3")})),
            Block(frozenset({("R1", "R2")})),
        ),
    ],
)
def test_faults_are_made_as_plain_as_they_may_be(fault: Fault, plain: Fault) -> None:
    def fails(smaller: Scenario) -> bool:
        for _, found in smaller.steps:
            match found:
                case Garbage():
                    return True
                case Disturb(link) if link.loss_permille == 300:
                    return True
                case Block(links) if ("R1", "R2") in links:
                    return True
        return False

    found = minimise(scenario((SECOND_US, fault)), fails, math.inf)
    assert found.scenario.steps[0] == (SECOND_US, plain)


def test_without_budget_the_schedule_stays_as_it_is() -> None:
    start = scenario((SECOND_US, Kill("R2")))
    found = minimise(start, lambda smaller: True, -1.0)
    assert not found.is_done
    assert found.scenario == start
    assert found.runs == 0


def test_progress_is_told_after_each_run() -> None:
    told: list[tuple[int, int]] = []
    found = minimise(
        scenario((SECOND_US, Kill("R2"))),
        lambda smaller: has(smaller, Kill("R2")),
        math.inf,
        lambda runs, left: told.append((runs, left)),
    )
    assert [runs for runs, _ in told] == list(range(1, found.runs + 1))
    assert told[-1][1] == 1
