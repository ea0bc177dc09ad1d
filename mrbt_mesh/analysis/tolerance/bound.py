"""Global tasks for the robots that did another one before (`same_robot_as`), as services.

The plan decides which robots do the first task, and they may be lost as soon as they have done it.
So the second task can only be counted on if it can be served whichever robots did the first one,
with none of them lost, and if the first one is always done before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, product
from math import comb, prod

from mrbt_mesh.analysis.tolerance.service import JointNeed, Service, entries_of, service
from mrbt_mesh.core.bt.tree import Kind, Tree
from mrbt_mesh.core.mission.mission import GlobalTask, Mission, Need

MAX_CHOICES = 200
# Their success implies that of the child on the way to a task: of all children, or of the first.
_OF_ALL = frozenset({Kind.SEQUENCE, Kind.SUBTREE, Kind.RETRY, Kind.REPEAT, Kind.TIMEOUT})


def bound_services(mission: Mission, task: GlobalTask) -> tuple[Service, ...]:
    """Return what is needed, besides enough robots, to serve a task with `same_robot_as`."""
    bound = {need.local_task: need for need in task.needs if need.same_robot_as and need.min_robots}
    if not bound:
        return ()
    befores = {name: _before(mission, need) for name, need in bound.items()}
    for need in bound.values():
        if not is_done_before(mission.tree, need, task.id):
            nobody = JointNeed(need.local_task, 1, {})
            name = (
                f"{task.id}, as no robot need have{need.after.replace(' that did', ' done')} before"
            )
            return (Service(name, (task.id,), (nobody,), False, is_bound=True),)
    needs = service(mission, (task,), task.id).needs
    name = f"{task.id} whichever robots{', '.join(need.after for need in bound.values())}"
    unable = sorted(
        {
            robot
            for need in needs
            if need.local_task in befores
            for robot in befores[need.local_task][0]
            if robot not in need.entries
        }
    )
    name += f" ({', '.join(unable)} may have and cannot)" if unable else ""
    found = []
    for chosen in _choices(befores, len(needs)):
        limited = tuple(_limited(each, chosen) for each in needs)
        found.append(Service(name, (task.id,), limited, False, is_bound=True))
    if found:
        return tuple(found)
    # Too many choices: each bound need alone, the others without the robots that may be bound.
    taken = {robot for robots, _ in befores.values() for robot in robots}
    limited = tuple(
        _all_but_spare(each, bound[each.local_task], befores[each.local_task])
        if each.local_task in bound
        else replace(each, entries={r: e for r, e in each.entries.items() if r not in taken})
        for each in needs
    )
    return (Service(name, (task.id,), limited, False, is_bound=True),)


def _before(mission: Mission, need: Need) -> tuple[list[str], int]:
    """Return the robots that may have done it, and how many of them will have."""
    before = need.same_robot_as
    assert before is not None
    robots = [
        robot.id
        for robot in mission.robots.values()
        if entries_of(robot.capabilities, robot.id, before.local_task)
    ]
    needs = mission.global_tasks[before.global_task].needs
    return robots, next(n.min_robots for n in needs if n.local_task == before.local_task)


def _choices(
    befores: dict[str, tuple[list[str], int]], needs: int
) -> Iterator[dict[str, set[str]]]:
    """Yield the ways in which robots may have done it, if these are few.

    One need alone is a count.
    """
    if needs == 1 or prod(comb(len(r), count) for r, count in befores.values()) > MAX_CHOICES:
        return
    for chosen in product(*(combinations(robots, count) for robots, count in befores.values())):
        yield {name: set(robots) for name, robots in zip(befores, chosen, strict=True)}


def _limited(need: JointNeed, chosen: dict[str, set[str]]) -> JointNeed:
    """Return a need; if it is bound, only the chosen robots can meet it."""
    if need.local_task not in chosen:
        return need
    robots = chosen[need.local_task]
    return replace(need, entries={r: e for r, e in need.entries.items() if r in robots})


def _all_but_spare(need: JointNeed, bound: Need, before: tuple[list[str], int]) -> JointNeed:
    """Return a need for enough able robots, of those that may have done it, to make any choice
    sufficient.
    """
    robots, count = before
    entries = {robot: e for robot, e in need.entries.items() if robot in robots}
    return JointNeed(need.local_task, len(robots) - count + bound.min_robots, entries)


def is_done_before(tree: Tree, need: Need, task: str) -> bool:
    """Return whether the tree reaches a task only after what `same_robot_as` names succeeded."""
    before = need.same_robot_as
    assert before is not None
    places = [node.index for node in tree.actions() if node.subject == before.global_task]
    return all(
        any(_leads_to(tree, place, node.index) for place in places)
        for node in tree.actions()
        if node.subject == task
    )


def _leads_to(tree: Tree, before: int, after: int) -> bool:
    above = {after: -1}
    node = after
    while (parent := tree.nodes[node].parent) >= 0:
        above[parent] = node
        node = parent
    child, node = before, tree.nodes[before].parent
    while node not in above:
        kind, children = tree.nodes[node].kind, tree.nodes[node].children
        is_all = kind is Kind.PARALLEL and tree.nodes[node].limit == len(children)
        is_first = kind is Kind.FALLBACK and child == children[0]
        if not (kind in _OF_ALL or is_all or is_first):
            return False
        child, node = node, tree.nodes[node].parent
    children = tree.nodes[node].children
    order = children.index(child), children.index(above[node])
    if tree.nodes[node].kind is Kind.IF_THEN_ELSE:
        return order == (0, 1)
    return tree.nodes[node].kind is Kind.SEQUENCE and order[0] < order[1]
