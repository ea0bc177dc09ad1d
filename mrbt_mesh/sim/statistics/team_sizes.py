"""Teams of other sizes than the mission file's, for comparisons.

A larger team repeats the file's robots in turn; a smaller one has robots that unite what
several of the file's can do. So every robot type of the file is there in every team.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mrbt_mesh.core.mission.mission import MAX_ROBOTS, Mission, Need, Robot, performance
from mrbt_mesh.core.mission.names import is_robot_id


def resized(mission: Mission, size: int) -> Mission:
    """The mission with a team of `size` robots; the file's own team stays as it is.

    Robot k of a larger team is a copy of robot k modulo n of the file's n (`A1`, ..., then
    `A1-2`). Robot k of a smaller one unites the robots k, k + size, k + 2 size ... (`A1-C1`): it
    has all their capabilities, each with the best performance. Where fewer robots can do a local
    task than its `min`, all that can are enough: one robot lifts alone what takes two otherwise.
    Raises ValueError for sizes below 1 or beyond the limit.
    """
    robots = [mission.robots[name] for name in sorted(mission.robots)]
    if not 1 <= size <= MAX_ROBOTS:
        raise ValueError(f"a team has 1 to {MAX_ROBOTS} robots, not {size}")
    if size == len(robots):
        return mission
    if size > len(robots):
        team = [_copy(robots[k % len(robots)], k // len(robots)) for k in range(size)]
    else:
        team = [_united(robots[k::size]) for k in range(size)]
    if len({robot.id for robot in team}) < size or not all(is_robot_id(r.id) for r in team):
        team = [replace(robot, id=f"R{k + 1}") for k, robot in enumerate(team)]
    tasks = {
        name: replace(task, needs=tuple(_within(need, team) for need in task.needs))
        for name, task in mission.global_tasks.items()
    }
    return replace(
        mission,
        robots={robot.id: robot for robot in sorted(team, key=lambda robot: robot.id)},
        robot_types={robot.type: robot.capabilities for robot in team},
        global_tasks=tasks,
    )


def _copy(robot: Robot, number: int) -> Robot:
    return replace(robot, id=f"{robot.id}-{number + 1}") if number else robot


def _united(robots: list[Robot]) -> Robot:
    best: dict[str, int] = {}
    for robot in robots:
        for name, value in robot.capabilities.items():
            best[name] = max(value, best.get(name, 0))
    types = sorted({robot.type for robot in robots})
    return Robot("-".join(robot.id for robot in robots), "-".join(types), best)


def _within(need: Need, team: list[Robot]) -> Need:
    able = sum(performance(robot.capabilities, need.local_task) is not None for robot in team)
    return replace(need, min_robots=min(need.min_robots, max(1, able)))


def describe(robots: Mapping[str, Robot]) -> str:
    """A team in a few words: `2 A, 2 B, 2 C`."""
    types = [robot.type for robot in robots.values()]
    return ", ".join(f"{types.count(kind)} {kind}" for kind in sorted(set(types)))
