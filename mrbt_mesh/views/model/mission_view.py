"""What a page needs to know about a mission once: its tree, robots, tasks and map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from mrbt_mesh.core.bt.tree import Tree
from mrbt_mesh.core.mission.mission import MICRO, GlobalTask, Mission
from mrbt_mesh.features.bids.needs import by_bid
from mrbt_mesh.features.exclusive.fields import is_simultaneous
from mrbt_mesh.formats.mission_map import map_view
from mrbt_mesh.views.model.job_types import job_types, submit_example


def mission_view(mission: Mission) -> dict[str, Any]:
    """Return the mission as plain data; performances are in units."""
    leaves: dict[str, list[int]] = {}
    types = job_types(mission)
    for node in mission.tree.actions():
        leaves.setdefault(node.subject, []).append(node.index)
    return {
        "name": mission.name,
        "digest": mission.digest[:16],
        "revision": mission.number,
        "ends": str(mission.ends),
        "tree": tree_view(mission.tree),
        "robots": {
            robot.id: {"type": robot.type, "capabilities": in_units(robot.capabilities)}
            for robot in mission.robots.values()
        },
        "types": {name: in_units(table) for name, table in sorted(mission.robot_types.items())},
        "tasks": {
            name: _task(task) | {"nodes": leaves.get(name, [])}
            for name, task in mission.global_tasks.items()
        },
        "job_types": [asdict(each) for each in types],
        "submit": submit_example(types[0]) if types else None,
        "map": map_view(mission),
    }


def tree_view(tree: Tree) -> list[dict[str, Any]]:
    """Return one row per node, by index; `parent` is -1 at the root."""
    return [
        {
            "kind": str(node.kind),
            "label": node.label,
            "name": node.name,
            "subject": node.subject,
            "parent": node.parent,
        }
        for node in tree.nodes
    ]


def in_units(performances: Mapping[str, int]) -> dict[str, float]:
    """Convert micro-units to units."""
    return {name: value / MICRO for name, value in sorted(performances.items())}


def _task(task: GlobalTask) -> dict[str, Any]:
    return {
        "needs": [
            {
                "local_task": need.local_task,
                "min": need.min_robots,
                "max": need.max_robots,
                "by_bid": by_bid(need),
            }
            for need in task.needs
        ],
        "simultaneous": is_simultaneous(task),
        "exclusive": task.at_most_once,
    }
