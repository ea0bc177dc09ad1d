"""The order of tasks: levels by place and priority, arrival within them."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.planning.task_order import task_order
from mrbt_mesh.formats.build import mission_from_yaml
from tests.support.build import World

MISSION = """
mission: order
ends: never
local_tasks: {left: {}, right: {}, look: {parameters: [n]}, lift: {parameters: [n]}}
robot_types: {r: {capabilities: {left: 1, right: 1, look: 1, lift: 1}}}
robots: {R1: r}
global_tasks:
  left: {needs: {left: {min: 1}}}
  right: {needs: {right: {min: 1}}}
  look: {parameters: [n], needs: {look($n): {min: 1}}}
  lift: {parameters: [n], needs: {lift($n): {min: 1}}}
jobs:
  a: {parameters: {n: {min: 1, max: 9}}, tree: {Parallel: [look($n), lift($n)]}}
tree: {Parallel: [left, {Jobs: {types: [a], at_most: 9}}, right]}
"""


def submit(world: World, name: str, stamp: int, priority: int) -> None:
    world.command(f"{records.JOB}/{name}", ["a", ["1"], priority, 0, 0, stamp], stamp, name)


def test_what_is_left_of_jobs_comes_first_then_jobs_by_priority_and_arrival() -> None:
    world = World(mission_from_yaml(MISSION, "mission.yaml", Path()))
    for name, stamp, priority in (("first", 1, 0), ("second", 2, 0), ("urgent", 3, 9)):
        submit(world, name, stamp, priority)
    requests = world.facts.mission.evaluator.evaluate(world.facts).requests
    found = task_order(world.facts, requests)
    places = [(found[each.activation].level, found[each.activation].arrival) for each in requests]
    # left, both tasks of each job in the order of the tree, right.
    (left, *jobs, right), levels = places, sorted({level for level, _ in places})
    assert levels == [0, 1, 2, 3]
    assert (left[0], right[0]) == (0, 3)
    assert jobs[0] == jobs[1]
    assert [level for level, _ in jobs] == [1, 1, 2, 2, 2, 2]
    assert jobs[2] == jobs[3] < jobs[4] == jobs[5]


def test_a_plain_tree_has_no_order() -> None:
    text = MISSION.partition("jobs:")[0] + "tree: {Parallel: [left, right]}\n"
    world = World(mission_from_yaml(text, "mission.yaml", Path()))
    requests = world.facts.mission.evaluator.evaluate(world.facts).requests
    assert len(set(task_order(world.facts, requests).values())) == 1


def test_ties_go_to_the_robot_that_has_worked_on_the_fewest_jobs() -> None:
    text = MISSION.replace("robots: {R1: r}", "robots: {R1: r, R2: r, R3: r}")
    world = World(mission_from_yaml(text, "mission.yaml", Path()))
    assert world.facts.by_share(["R3", "R1", "R2"]) == ["R1", "R2", "R3"]
    for name, robots in (("a", ("R1", "R2")), ("b", ("R1",))):
        end = records.JobEnd(records.JobState.SUCCEEDED, "a", ("1",), "me", "", robots, 5, 1)
        for robot in ("R1", "R2"):
            world.write(robot, (f"{records.JOB_END}/{name}", end))
    assert world.facts.by_share(["R1", "R2", "R3"]) == ["R3", "R2", "R1"]
    submit(world, "c", 6, 0)
    assignments = world.plan().assignments
    assert assignments["R3"].global_task == "left"
