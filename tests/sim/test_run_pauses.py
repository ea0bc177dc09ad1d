"""A robot whose machine is paused with all its clocks does not work beside its replacement."""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.membership.peer_clocks import PeerClocks
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.sim import Block, Fault, Pause, SimulationResult, Thaw, Unblock, simulate
from tests.support.effort import seeds

S, MS = 1_000_000, 1_000
STEP_S = 0.05
ROBOTS = ("R1", "R2", "R3")
EXCLUSIVE = """
mission: dose
local_tasks: {dose: {work: 9}}
robot_types: {r: {capabilities: {dose: 1}}}
robots: {R1: r, R2: r, R3: r}
global_tasks: {dosing: {needs: {dose: {min: 1, max: 1}}, exclusive: true, in_doubt: retry}}
tree: dosing
"""
PLACE = """
mission: dose
travel: {places: {home: [0, 0], shelf: [1, 0]}, speed: 1, start: {R1: home, R2: home, R3: home}}
local_tasks: {dose: {work: 9, at: shelf}}
robot_types:
  r: {capabilities: {dose: 1}, on_lost_contact: {of: majority, after_s: 1.5, then: hold}}
robots: {R1: r, R2: r, R3: r}
global_tasks: {dosing: {needs: {dose: {min: 1, max: 1}}}}
tree: dosing
"""


@dataclass(frozen=True)
class Run:
    """One run: (when, robot) of each step, who was paused, and when it went on."""

    result: SimulationResult
    steps: list[tuple[float, str]]
    paused: str
    thawed_s: float

    def beside(self) -> list[float]:
        """How long after it went on the paused robot did steps while another one worked."""
        others_s = [at_s for at_s, robot in self.steps if robot != self.paused]
        mine_s = [at_s for at_s, robot in self.steps if robot == self.paused]
        during = (at_s for at_s in mine_s if others_s and others_s[0] < at_s < others_s[-1])
        return [at_s - self.thawed_s for at_s in during]


def run(text: str, seed: int, deaf_s: float = 0.0, kept_s: float = 0.0) -> Run:
    """Pause the robot at work; `deaf_s`: for so long after that nothing reaches it. `kept_s`: only
    what was sent in that part of the pause waits for it.
    """
    dice = random.Random(seed)
    steps: list[tuple[float, str]] = []
    program = RobotProgram()

    @program.local_task
    async def dose(task: TaskContext) -> None:
        for _ in range(round(9 / STEP_S)):
            await anyio.sleep(STEP_S)
            # The world's time, not that of the robot's clock.
            steps.append((task.unix_time_s(), task.robot))

    mission = mission_from_yaml(text, "dose.yaml", Path())
    # The replacement has begun by then, and is not done yet.
    pause_us, length_us = dice.randint(3 * S, 6 * S), dice.randint(6 * S, 11 * S)
    thaw_us = pause_us + length_us
    schedule: list[tuple[int, Fault]] = [(pause_us, Pause("R1")), (thaw_us, Thaw("R1"))]
    if deaf_s:
        links = frozenset((each, "R1") for each in ROBOTS if each != "R1")
        schedule.insert(1, (pause_us + 1 + round(kept_s * S), Block(links)))
        schedule.append((thaw_us + round(deaf_s * S), Unblock(links)))
    result = simulate(mission, program, seed=seed, schedule=schedule, keep_log=True)
    return Run(result, steps, "R1", thaw_us / S)


@pytest.mark.parametrize("text", [EXCLUSIVE, PLACE], ids=["exclusive", "place"])
@pytest.mark.parametrize("seed", seeds(100))
def test_what_a_robot_hears_first_after_a_pause_comes_before_its_next_step(
    text: str, seed: int
) -> None:
    found = run(text, seed)
    assert {robot for _, robot in found.steps} > {"R1"}, "another robot has taken over"
    assert found.beside() == [], f"seed {seed}"
    if text == EXCLUSIVE:
        assert found.result.violations == [], f"seed {seed}"
    assert any('"clock_stood_still"' in line for line in found.result.effect_log)
    if text == EXCLUSIVE:
        assert any('"grants_ran_out"' in line for line in found.result.effect_log)


@pytest.mark.slow
@pytest.mark.parametrize("text", [EXCLUSIVE, PLACE], ids=["exclusive", "place"])
@pytest.mark.parametrize("seed", seeds(100))
def test_what_waits_may_show_only_the_begin_of_a_pause(text: str, seed: int) -> None:
    """As where links are given up after two seconds, and made again after the pause."""
    assert run(text, seed, deaf_s=0.4, kept_s=2).beside() == [], f"seed {seed}"


@pytest.mark.parametrize("seed", seeds(50))
def test_a_robot_that_hears_nothing_after_a_pause_stops_soon(seed: int) -> None:
    after_s = run(EXCLUSIVE, seed, deaf_s=5).beside()
    assert all(each_s <= Timing().news_us / S + STEP_S for each_s in after_s), f"seed {seed}"


def test_without_news_it_would_work_beside_its_replacement_as_long_as_it_counts_on_its_lease() -> (
    None
):
    with mock.patch.object(Timing, "news_us", 60 * S):
        found = [run(EXCLUSIVE, seed, deaf_s=5).beside() for seed in range(4)]
    assert max(max(each, default=0.0) for each in found) > 2 * Timing().news_us / S


def test_without_a_look_at_the_clocks_of_others_it_counts_on_its_lease_again() -> None:
    with mock.patch.object(PeerClocks, "aged_us", lambda _, robot, at_us: at_us):
        logs = [run(EXCLUSIVE, seed).result.effect_log for seed in range(4)]
    assert not any('"grants_ran_out"' in line for log in logs for line in log)


def test_a_short_pause_costs_nothing() -> None:
    """As of a machine that is moved while it runs."""
    schedule: list[tuple[int, Fault]] = []
    for at_us in range(2 * S, 8 * S, S):
        schedule += [(at_us, Pause("R1")), (at_us + 500 * MS, Thaw("R1"))]
    program, done = RobotProgram(), []

    @program.local_task
    async def dose(task: TaskContext) -> None:
        await anyio.sleep(9)
        done.append(task.robot)

    mission = mission_from_yaml(EXCLUSIVE, "dose.yaml", Path())
    result = simulate(mission, program, seed=1, schedule=schedule)
    assert (done, result.violations) == (["R1"], [])
