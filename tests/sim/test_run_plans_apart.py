"""Plans that are made outside of the agents: they take time, and the team does as well."""

from __future__ import annotations

import pytest

from mrbt_mesh.sim import Fault, Freeze, Kill, Lose, Thaw
from tests.support.runs import Run

MS = 1_000
SECOND_US = 1_000_000


@pytest.mark.slow
@pytest.mark.parametrize("delay_us", [0, 5 * MS, 80 * MS])
@pytest.mark.parametrize("name", ["vehicle_repair", "dispense", "explore"])
def test_a_mission_ends_as_it_should(run: Run, name: str, delay_us: int) -> None:
    result = run(name, 4, plan_delay_us=delay_us)
    assert result.summary["faults"] == []


@pytest.mark.slow
@pytest.mark.parametrize("delay_us", [5 * MS, 80 * MS])
def test_robots_that_die_while_others_plan_are_replaced(run: Run, delay_us: int) -> None:
    schedule: list[tuple[int, Fault]] = [
        (3 * SECOND_US, Kill("A1")),
        (5 * SECOND_US, Lose("B1", "do_diagnosis")),
        (6 * SECOND_US, Freeze("B2")),
        (9 * SECOND_US, Thaw("B2")),
    ]
    result = run("vehicle_repair", 2, schedule=schedule, plan_delay_us=delay_us)
    assert "A1" in {fault["robot"] for fault in result.summary["faults"]}


def test_nobody_is_taken_for_dead_because_it_plans_for_long(run: Run) -> None:
    # Longer than the detection time, so a robot that did not beat meanwhile would be buried.
    result = run(
        "tool_search", 1, plan_delay_us=1_500 * MS, timeout_us=300 * SECOND_US, keep_log=True
    )
    assert any("MakePlan" in line for line in result.effect_log)
    assert result.summary["faults"] == []
    assert not any("fenced" in line for line in result.effect_log)
