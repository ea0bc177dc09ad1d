"""Coalitions whose members are stalled around their beginning: only those in time count."""

from __future__ import annotations

from pathlib import Path
from random import Random

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim import SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Freeze, Thaw
from tests.support.mutations import MUTATIONS

MISSION = """\
mission: lift
program: robot.py
local_tasks: {hold: {work: 1}}
robot_types: {bot: {capabilities: {hold: 1}}}
robots: {R1: bot, R2: bot, R3: bot}
global_tasks:
  pair: {simultaneous: true, WITHIN needs: {hold: {min: 2, max: MAX}}}
tree: pair
"""


def stalled(
    tmp_path: Path, seed: int, work_s: float, within_s: float | None = None, most: int = 2
) -> SimulationResult:
    """A run in which robots freeze and thaw while their coalition forms."""
    random, robot = Random(seed), RobotProgram(record_work=True)

    @robot.local_task
    async def hold(task: TaskContext) -> None:
        await anyio.sleep(work_s)

    within = f"begin_within_s: {within_s}," if within_s is not None else ""
    file = tmp_path / f"{seed}.yaml"
    file.write_text(MISSION.replace("WITHIN", within).replace("MAX", str(most)))
    schedule = []
    for name in random.sample(("R1", "R2", "R3"), random.randint(1, 2)):
        at_us, for_us = random.randint(20_000, 60_000), random.randint(100_000, 1_500_000)
        schedule += [(at_us, Freeze(name)), (at_us + for_us, Thaw(name))]
    return simulate(load_mission(file), robot, seed=seed, schedule=schedule, timeout_us=60_000_000)


def counted_begins_s(found: SimulationResult) -> list[float]:
    """When the robots of the coalition that counts began: each last began what it ended."""
    begun: dict[str, float] = {}
    for event in found.events:
        if event["event"] == "start":
            begun[event["robot"]] = event["t"]
    ended = [e for e in found.events if e["event"] == "end" and e["outcome"] == "success"]
    return sorted(begun[event["robot"]] for event in ended[-2:])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_only_what_began_in_time_counts(seed: int, tmp_path: Path) -> None:
    work_s, within_s = (0.05, 0.4, 3.0)[seed % 3], (None, 0.2, 0.5)[seed // 3 % 3]
    found = stalled(tmp_path, seed, work_s, within_s)
    assert (found.result, found.violations) == ("success", [])
    first_s, second_s = counted_begins_s(found)
    # By their own clocks, and none begins after the other has ended but for a message's time.
    assert second_s - first_s <= min(within_s or 1.0, work_s + 0.31)


@pytest.mark.parametrize("seed", range(10))
def test_so_do_those_with_more_members_than_needed(seed: int, tmp_path: Path) -> None:
    found = stalled(tmp_path, seed, 0.4, most=3)
    assert (found.result, found.violations) == ("success", [])


def test_the_checker_sees_partners_that_are_late(tmp_path: Path) -> None:
    def run(seed: int) -> list[str]:
        return stalled(tmp_path, seed, 0.4, 0.2).violations

    assert not any(run(seed) for seed in range(12))
    with MUTATIONS["partners_may_be_late"]():
        late = [text for seed in range(12) for text in run(seed)]
    assert any("began" in text and text.startswith("I4") for text in late), late
