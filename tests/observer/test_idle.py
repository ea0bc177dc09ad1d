"""Robots without an assignment, and why they have none."""

from __future__ import annotations

from mrbt_mesh.core.facts.store import Incarnation
from tests.support.build import World, action, make_mission, sequence, task


def lift_and_look() -> World:
    """Two robots lift together, then one looks."""
    robots = {"A1": {"look": 1.0}, "C1": {"lift": 1.0}, "C2": {"lift": 1.0}}
    tasks = [task("cover", ("lift", 2, 2)), task("part", ("look", 1, 1))]
    return World(make_mission(sequence(action("cover"), action("part")), robots, tasks))


def test_every_robot_without_a_task_learns_why() -> None:
    world = lift_and_look()
    assert world.idle() == {"A1": "nothing it can do is needed now"}
    for robot in ("C1", "C2"):
        world.outcome(world.activation("cover"), True, robot, "lift")
    world.leave("C1")
    assert world.idle() == {"C1": "leaving", "C2": "nothing it can do is needed now"}
    world.outcome(world.activation("part"), True, "A1", "look")
    assert world.idle()["A1"] == "nothing is requested"


def test_a_robot_that_nobody_has_heard_describe_itself_is_not_leaving() -> None:
    world = World(make_mission(action("a"), {"R1": {"a": 1}, "R2": {"a": 1}}))
    world.alive["R3"] = Incarnation(1, "n")
    assert world.idle()["R3"] == "what it can do is not known yet"
    life = world.alive["R2"]
    world.alive["R2"] = Incarnation(life.counter + 1, life.nonce)
    assert world.idle()["R2"] == "what it can do is not known yet", "of this life"


def test_a_robot_that_is_not_needed_any_more_learns_for_what() -> None:
    lift = task("lift", ("lift", 1, 1))
    world = World(make_mission(action("lift"), {n: {"lift": 1.0} for n in "AB"}, [lift]))
    assert world.idle() == {"B": "lift: enough robots are on it"}
