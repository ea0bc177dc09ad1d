"""Variations of a mission, for teams whose mission is revised while they run."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace

from mrbt_mesh.core.bt.tree import LEAVES, Kind, Node, NodeSpec, TreeError, build_tree
from mrbt_mesh.core.mission.mission import FailurePolicy, Mission

_IN_ORDER = (Kind.SEQUENCE, Kind.FALLBACK)
_MANY = (*_IN_ORDER, Kind.PARALLEL)


def varied(mission: Mission, pick: random.Random) -> Mission:
    """The mission with one to three changes, of its tree, tasks or robots."""
    found = mission
    for _ in range(pick.randint(1, 3)):
        found = pick.choice((_drop, _again, _swap, _wrap, _other_task, _other_robots))(found, pick)
    return found


def _with_tree(mission: Mission, spec: NodeSpec) -> Mission:
    """With another tree; as it is if that breaks a rule of trees."""
    try:
        return replace(mission, tree=build_tree(spec))
    except TreeError:
        return mission


def _controls(mission: Mission) -> Iterator[Node]:
    """Controls whose children may be changed: none with or in a Jobs node."""
    has_jobs = mission.tree.containing(Kind.JOBS)
    for node in mission.tree.nodes:
        if node.kind in _MANY and not has_jobs[node.index]:
            yield node


def _changed(mission: Mission, at: int, children: tuple[NodeSpec, ...]) -> Mission:
    def copy(index: int) -> NodeSpec:
        node = mission.tree.nodes[index]
        if index == at:
            limit = min(node.limit, len(children)) if node.kind is Kind.PARALLEL else node.limit
            return replace(node.spec(children), limit=limit, failures=0)
        return node.spec(tuple(map(copy, node.children)))

    return _with_tree(mission, copy(0))


def _control(mission: Mission, pick: random.Random) -> tuple[Node, list[NodeSpec]] | None:
    found = list(_controls(mission))
    if not found:
        return None
    node = pick.choice(found)
    return node, [mission.tree.spec(child) for child in node.children]


def _drop(mission: Mission, pick: random.Random) -> Mission:
    """One child less."""
    found = _control(mission, pick)
    if found is None or len(found[1]) < 2:
        return mission
    node, children = found
    del children[pick.randrange(len(children))]
    return _changed(mission, node.index, tuple(children))


def _again(mission: Mission, pick: random.Random) -> Mission:
    """One more leaf, of a task that is there."""
    found, leaves = _control(mission, pick), sorted(mission.global_tasks)
    if found is None or not leaves:
        return mission
    node, children = found
    leaf = NodeSpec(Kind.ACTION, subject=pick.choice(leaves))
    children.insert(pick.randint(0, len(children)), leaf)
    return _changed(mission, node.index, tuple(children))


def _swap(mission: Mission, pick: random.Random) -> Mission:
    """The children of a control in another order."""
    found = _control(mission, pick)
    if found is None:
        return mission
    node, children = found
    pick.shuffle(children)
    return _changed(mission, node.index, tuple(children))


def _wrap(mission: Mission, pick: random.Random) -> Mission:
    """Something around the whole tree, or around a leaf."""
    leaves = [node for node in mission.tree.nodes if node.kind in LEAVES and not node.job]
    if pick.random() < 0.5 or not leaves or mission.jobs:
        return _with_tree(mission, NodeSpec(Kind.SEQUENCE, (mission.tree.spec(),)))
    at = pick.choice(leaves).index
    kind = pick.choice((Kind.FORCE_SUCCESS, Kind.RETRY))

    def copy(index: int) -> NodeSpec:
        node = mission.tree.nodes[index]
        spec = node.spec(tuple(map(copy, node.children)))
        limit = 2 if kind is Kind.RETRY else 0
        return NodeSpec(kind, (spec,), limit=limit) if index == at else spec

    return _with_tree(mission, copy(0))


def _other_task(mission: Mission, pick: random.Random) -> Mission:
    """A task with another policy, or one robot more or less."""
    names = sorted(mission.global_tasks)
    if not names:
        return mission
    task = mission.global_tasks[pick.choice(names)]
    if pick.random() < 0.5:
        policies = [each for each in FailurePolicy if each != task.failure]
        changed = replace(task, failure=pick.choice(policies))
    else:
        first, *others = task.needs
        changed = replace(task, needs=(replace(first, max_robots=first.max_robots + 1), *others))
    return replace(mission, global_tasks={**mission.global_tasks, task.id: changed})


def _other_robots(mission: Mission, pick: random.Random) -> Mission:
    """A robot of another type, or without one capability."""
    robot = mission.robots[pick.choice(sorted(mission.robots))]
    kind = pick.choice(sorted(mission.robot_types))
    able = dict(mission.robot_types[kind])
    if len(able) > 1 and pick.random() < 0.5:
        del able[pick.choice(sorted(able))]
    changed = replace(robot, type=kind, capabilities=able)
    return replace(mission, robots={**mission.robots, robot.id: changed})
