"""Revisions: another mission in the place of the one that a team runs.

Facts name the nodes of the tree by numbers. `revise` gives the nodes of the new tree the numbers of
the same nodes in the old one, so that their activations keep names, outcomes and claims. All other
nodes get numbers that were never used: what is done there begins again.

The same node is: an action whose global task has not changed in anything, of several in their
order; a node that remembers (Retry, Repeat, Timeout, nodes with memory) with all that is below it,
if none of that has changed; any other node with the same nodes below it. In any case the conditions
that guard it must be the same.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import replace

from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, Kind, Memory, Node, Tree
from mrbt_mesh.core.mission.jobs import type_at
from mrbt_mesh.core.mission.mission import GlobalTask, Mission, Revision

_REMEMBERING = ATTEMPT_KINDS | {Kind.TIMEOUT}


class RevisionError(ValueError):
    """Why a mission cannot take the place of another one, in words for the operator."""


def revise(before: Mission, after: Mission, number: int | None = None) -> Mission:
    """`after` as the revision that follows `before`, with the numbers of nodes that are the same.

    `number`: that of the revision, None: the next one. Raises RevisionError if a team cannot go
    from one to the other.
    """
    _check(before, after)
    known = before.revision
    team = before.digest if known is None else known.team
    next_node = len(before.tree.nodes) if known is None else known.next_node
    number = before.revision_number + 1 if number is None else number
    origin_of = _matching(before, after)
    while True:
        numbers, unused = [], next_node
        for node in after.tree.nodes:
            if node.index in origin_of:
                numbers.append(before.tree.nodes[origin_of[node.index]].number)
            else:
                numbers.append(unused)
                unused += 1
        found = replace(
            after,
            tree=after.tree.with_numbers(numbers),
            revision=Revision(number, team, unused),
        )
        others = _with_other_guards(before, found, origin_of)
        if not others:
            return found
        for index in others:
            del origin_of[index]


def _check(before: Mission, after: Mission) -> None:
    """A condition's revisions count from its default, so that must stay."""
    for name, condition in sorted(after.conditions.items()):
        known = before.conditions.get(name)
        if known is not None and known.to_json() != condition.to_json():
            raise RevisionError(
                f"condition {name} is declared otherwise than in the mission that runs: keep it as "
                "it is there, or declare one of another name"
            )


def _matching(before: Mission, after: Mission) -> dict[int, int]:
    """By node of `after`: the same node of `before`, where there is one."""
    known: dict[Hashable, list[int]] = {}
    for key, index, _ in _keys(before):
        known.setdefault(key, []).append(index)
    found: dict[int, int] = {}
    for key, index, size in _keys(after):
        same = known.get(key)
        if same:
            first = same.pop(0)
            found |= {index + step: first + step for step in range(size)}
    return found


def _keys(mission: Mission) -> Iterator[tuple[Hashable, int, int]]:
    """What makes a node the same one, the node, and how many nodes are matched with it: of a node
    that remembers all below it, else itself alone.
    """
    tree = mission.tree
    plain, sizes = tree.with_numbers(range(len(tree.nodes))), _sizes(tree)
    for node, unit in zip(tree.nodes, units(tree), strict=True):
        if unit != node.index:
            continue
        kind, size = type_at(mission, node.index), sizes[node.index]
        parameters = None if kind is None else (kind.name, kind.parameters)
        below = tree.nodes[node.index : node.index + size]
        tasks = tuple(repr(_task(mission, each)) for each in below if each.kind is Kind.ACTION)
        shape = "" if node.kind is Kind.ACTION else repr(plain.spec(node.index))
        yield (parameters, shape, tasks), node.index, size if _remembers(node) else 1


def units(tree: Tree) -> list[int]:
    """By node: the outermost node that remembers, at or above it; the node itself if none does."""
    found: list[int] = []
    for node in tree.nodes:
        above = found[node.parent] if node.parent >= 0 else -1
        is_inside = above >= 0 and _remembers(tree.nodes[above])
        found.append(above if is_inside else node.index)
    return found


def _remembers(node: Node) -> bool:
    return node.kind in _REMEMBERING or node.memory is not Memory.NONE


def _sizes(tree: Tree) -> list[int]:
    """By node: how many nodes its subtree has."""
    found = [1] * len(tree.nodes)
    for node in reversed(tree.nodes):
        if node.parent >= 0:
            found[node.parent] += found[node.index]
    return found


def _task(mission: Mission, node: Node) -> GlobalTask:
    """The global task of an action, in a job's tree with placeholders."""
    kind = type_at(mission, node.index)
    of_type = kind.global_tasks.get(node.subject) if kind is not None else None
    return of_type or mission.global_tasks[node.subject]


def _with_other_guards(before: Mission, after: Mission, origin_of: Mapping[int, int]) -> list[int]:
    """Nodes that are guarded otherwise than those whose numbers they have, each with its unit: the
    turns of guards are a part of activations.
    """
    old, new = before.evaluator.guards_of, after.evaluator.guards_of
    have_other_robots = before.robot_ids != after.robot_ids
    unit_of = units(after.tree)
    changed = {
        unit_of[index]
        for index, origin in origin_of.items()
        if old[origin] != new[index]
        or (have_other_robots and any(_reads_each(after, name) for name, _ in new[index]))
    }
    return [index for index in origin_of if unit_of[index] in changed]


def _reads_each(mission: Mission, guard: str) -> bool:
    """Whether a guard reads a condition that every robot has for itself."""
    own = mission.per_robot
    if guard in own:
        return True
    return guard.startswith("#") and any(name in own for name in own.read_by(guard))
