"""Robots that are cut off stop in time, and nobody begins before at places where they may be."""

from __future__ import annotations

import random
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.features.contact.policy import ATTEND
from mrbt_mesh.features.contact.watch import ContactWatch
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.sim import Command, Fault, SimulationResult, Unblock, partition, simulate
from tests.support.effort import at_size

S = 1_000_000
STEP_S, AFTER_S, CUT_S = 0.1, 3, 12
ROBOTS = ("A1", "A2", "A3", "A4", "A5")
MISSION = """
mission: rounds
parameters: {places: [p1, p2, p3, p4]}
travel:
  places: {home: [0, 0], p1: [2, 0], p2: [0, 2], p3: [2, 2], p4: [4, 0]}
  speed: 1
  start: {A1: home, A2: home, A3: home, A4: home, A5: home}
  horizon: 1
local_tasks:
  look: {parameters: [where], work: 2, at: $where}
  park: {work: 1}
robot_types:
  cart:
    capabilities: {look: 1, park: 1}
    on_lost_contact: CONTACT
robots: {A1: cart, A2: cart, A3: cart, A4: cart, A5: cart}
global_tasks:
  visit: {parameters: [where], needs: {look($where): {min: 1, max: 1}}}
tree:
  Parallel:
    success: all
    for_each: {where: $places}
    do: {Repeat: {cycles: 60, do: visit($where)}}
"""


@dataclass(frozen=True)
class Step:
    """A robot has moved or worked for STEP_S, on its way to a place or there."""

    at_s: float
    robot: str
    place: str


class World:
    """What robots physically do, step by step."""

    def __init__(self, contact: str) -> None:
        self.steps: list[Step] = []
        self.program = RobotProgram()
        self.mission = mission_from_yaml(MISSION.replace("CONTACT", contact), "rounds.yaml", Path())

        @self.program.travel
        async def go(task: TaskContext, place: str) -> None:
            await self._move(task, place, 2.0)

        @self.program.local_task
        async def look(task: TaskContext, where: str) -> None:
            await self._move(task, where, task.simulation.duration_s)

        @self.program.local_task
        async def park(task: TaskContext) -> None:
            await self._move(task, "home", task.simulation.duration_s)

    async def _move(self, task: TaskContext, place: str, duration_s: float) -> None:
        for _ in range(round(duration_s / STEP_S)):
            await anyio.sleep(STEP_S)
            self.steps.append(Step(anyio.current_time(), task.robot, place))

    def run(self, *steps: tuple[float, Fault], seconds: float, seed: int = 1) -> SimulationResult:
        schedule = [(round(at_s * S), fault) for at_s, fault in steps]
        result = simulate(
            self.mission, self.program, seed=seed, schedule=schedule, timeout_us=round(seconds * S)
        )
        assert result.violations == [], f"seed {seed}"
        return result

    def after(self, at_s: float, robot: str) -> list[Step]:
        return [step for step in self.steps if step.robot == robot and step.at_s > at_s]


def contact(of: str, then: str, more: str = "") -> str:
    return f"{{after_s: {AFTER_S}, of: {of}, then: {then}{more}}}"


def cut(of: str, seed: int) -> tuple[World, float, set[str]]:
    """The world after a random cut, when it came, and who was cut off; all have contact again."""
    pick = random.Random(seed)
    world, at_s = World(contact(of, "hold")), pick.uniform(4, 12)
    away = set(pick.sample(ROBOTS, 1 if of == "team" else pick.choice([1, 2])))
    block = partition(away, set(ROBOTS) - away)
    heal = (at_s + CUT_S, Unblock(block.links))
    facts = world.run((at_s, block), heal, seconds=at_s + CUT_S + 4, seed=seed).observer.facts
    assert not any(known.member.pending for known in facts.members.values())
    return world, at_s, away


def too_late(world: World, at_s: float, away: set[str]) -> list[Step]:
    """Steps of those who were cut off, later than allowed."""
    end_s = at_s + AFTER_S + STEP_S + 0.01
    return [s for s in world.steps if s.robot in away and end_s < s.at_s < at_s + CUT_S]


def shared_places(world: World, at_s: float, away: set[str]) -> list[str]:
    """Places at which robots of both sides were at once during the cut."""
    during: dict[tuple[str, bool], list[float]] = defaultdict(list)
    for step in world.steps:
        if at_s < step.at_s < at_s + CUT_S:
            during[step.place, step.robot in away].append(step.at_s)
    found = []
    for place in world.mission.parameters["places"]:
        inside, outside = during[place, True], during[place, False]
        # The side that is there first has left for good when the other one comes.
        if inside and outside and min(outside) < max(inside) and min(inside) < max(outside):
            found.append(place)
    return found


@pytest.mark.parametrize("of", ["team", "majority"])
@pytest.mark.parametrize("seed", range(at_size(quick=2, gate=30, long=100)))
def test_no_step_after_the_time_and_nobody_at_the_place_before(of: str, seed: int) -> None:
    world, at_s, away = cut(of, seed)
    assert too_late(world, at_s, away) == [], f"seed {seed}"
    assert shared_places(world, at_s, away) == [], f"seed {seed}"
    others = [s for s in world.steps if s.robot not in away and at_s + 6 < s.at_s < at_s + CUT_S]
    assert others, "the others have gone on"


@pytest.mark.slow
def test_without_the_rule_both_sides_are_at_one_place() -> None:
    with mock.patch.object(ContactWatch, "may_begin", return_value=True):
        found = [shared_places(*cut("majority", seed)) for seed in range(4)]
    assert any(found)


@pytest.mark.slow
def test_a_robot_that_finishes_ends_its_task_and_begins_no_other() -> None:
    world = World(contact("team", "finish"))
    block = partition({"A1"}, set(ROBOTS) - {"A1"})
    world.run((5.0, block), seconds=40)
    last = world.after(5, "A1")[-1]
    assert last.at_s < 5 + AFTER_S + 4 + 3 * STEP_S, "a way and its work at most"


@pytest.mark.slow
def test_a_robot_that_returns_performs_its_local_task_and_works_again_later() -> None:
    world = World(contact("team", "return", ", return: park"))
    block = partition({"A1"}, set(ROBOTS) - {"A1"})
    result = world.run((5.0, block), (20.0, Unblock(block.links)), seconds=40)
    parked = [step.at_s for step in world.after(0, "A1") if step.place == "home"]
    assert len(parked) == 10
    assert -0.5 <= parked[0] - 5 - AFTER_S <= 3 * STEP_S, "a heartbeat before the cut was the last"
    assert [s.place for s in world.after(parked[0] - STEP_S / 2, "A1") if s.at_s < 20] == [
        "home"
    ] * 10
    assert not result.observer.facts.members["A1"].member.pending


@pytest.mark.slow
def test_a_robot_without_an_operator_holds_and_the_team_goes_on_without_it() -> None:
    world = World(contact("operator", "hold"))
    here = [(float(at_s), Command(robot, ATTEND)) for at_s in range(1, 15) for robot in ROBOTS]
    later = [
        (float(at_s), Command(robot, ATTEND)) for at_s in range(15, 30) for robot in ROBOTS[1:]
    ]
    result = world.run(*here, *later, seconds=30)
    assert max(step.at_s for step in world.after(0, "A1")) <= 14 + AFTER_S + STEP_S + 0.01
    assert max(step.at_s for step in world.steps) > 29
    pending = result.observer.facts.members["A1"].member.pending
    assert set(pending.values()) == {"no contact with an operator"}
