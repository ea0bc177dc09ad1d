"""What a mission is allowed to say and hardly means: `mrbt validate` and `mrbt analyze` name it.

1. Alternatives that never get their turn. Where nobody has failed, and nobody who lives could do an
   action, it is blocked; with `blocked: wait` it never fails, and no Fallback above it goes on.
2. Actions that undo what led to them. One whose effects turn a condition against itself, that an
   earlier child of a Sequence asks, has another activation once it has succeeded: what led to it is
   done again, and so is the action.
3. Conditions that tell why a task failed which the tree never asks for: they never hold.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

from mrbt_mesh.analysis.places import child_path, root_path
from mrbt_mesh.analysis.tolerance.requirement import TooLargeError, could_fail
from mrbt_mesh.core.bt.evaluation import OwnFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import Expression, GuardWithActions
from mrbt_mesh.core.bt.tree import Kind, Node, Status
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name

MAX_NAMED = 3
# Expressions of more conditions are not tried out: they are taken to turn.
MAX_CONDITIONS = 8


def cautions(mission: Mission) -> list[str]:
    """All of them, in tree order, as lines for people."""
    found = [*_undoing_actions(mission), *_reasons_of_nothing(mission)]
    with contextlib.suppress(TooLargeError):  # `mrbt analyze` says so
        found = [*_stuck_fallbacks(mission), *found]
    return found


# -- alternatives that never get their turn ---------------------------------------------------


def _stuck_fallbacks(mission: Mission) -> Iterator[str]:
    services = {name: [number] for number, name in enumerate(mission.global_tasks)}
    for node in mission.tree.nodes:
        if node.kind is not Kind.FALLBACK:
            continue
        waiting: dict[str, None] = {}
        for child in node.children[:-1]:
            names = dict.fromkeys(_waiting_for_ever(mission, child))
            if names and could_fail(mission.tree, child, services):
                waiting.update(names)
        if waiting:
            named = _listed(list(waiting))
            yield (
                f"{_place(mission, node)}: the alternatives do not get their turn while nobody who "
                f"lives can do {named} and nobody has failed at it, since it waits for robots to "
                "return; with blocked: {fail_after_s: 20}, there or at the top of the file, it "
                "fails after that time"
            )


def _waiting_for_ever(mission: Mission, index: int) -> Iterator[str]:
    """The tasks at or below a node that wait while they are blocked, and that no Timeout ends."""
    node = mission.tree.nodes[index]
    if node.kind is Kind.ACTION:
        if mission.global_tasks[node.subject].blocked_fail_after_us is None:
            yield node.subject
    elif node.kind is not Kind.TIMEOUT:
        for child in node.children:
            yield from _waiting_for_ever(mission, child)


# -- actions that undo what led to them -------------------------------------------------------


def _undoing_actions(mission: Mission) -> Iterator[str]:
    guards = mission.evaluator
    for node in mission.tree.actions():
        effects = dict(mission.global_tasks[node.subject].effects)
        for parent, position in _ways_down(mission, node) if effects else ():
            turned = _turned_against(guards, parent, position, effects)
            if parent.kind is Kind.SEQUENCE and turned:
                yield (
                    f"{_place(mission, node)} sets {_listed(turned)}, and "
                    f"{_place(mission, parent)} asks for the opposite before it: once it has "
                    "succeeded, what led to it is done again; let that Sequence keep what has "
                    "passed (memory: while_running), or set it after the Sequence"
                )


def _turned_against(
    guards: Evaluator, parent: Node, position: int, effects: Mapping[str, bool]
) -> list[str]:
    """The effects that keep a child from being reached, of an action at or below it."""
    found: dict[str, None] = {}
    for left in range(1, position + 1):
        for name, against in guards.read_before(parent, left):
            found.update(dict.fromkeys(_turned_by(guards, name, against, effects)))
    return list(found)


def _ways_down(mission: Mission, node: Node) -> Iterator[tuple[Node, int]]:
    """The nodes above, from below, with the position of the child that leads down."""
    nodes = mission.tree.nodes
    while node.parent >= 0:
        parent = nodes[node.parent]
        yield parent, parent.children.index(node.index)
        node = parent


def _turned_by(
    guards: Evaluator, name: str, against: bool, effects: Mapping[str, bool]
) -> list[str]:
    """The effects that can turn a guard to the value that keeps the action from being reached."""
    guard = guards.expressions.get(name) or guards.with_actions.get(name)
    if guard is None:
        return [_effect(name, against)] if effects.get(name) is against else []
    read = [condition for condition in guard.conditions if condition in effects]
    if not read:
        return []
    if len(guard.conditions) <= MAX_CONDITIONS:
        for values in product((False, True), repeat=len(guard.conditions)):
            before = dict(zip(guard.conditions, values, strict=True))
            after = {**before, **{condition: effects[condition] for condition in read}}
            stands = _stands(guards, guard, before)
            if stands is not against and _stands(guards, guard, after) is against:
                break
        else:
            return []
    return [_effect(condition, effects[condition]) for condition in read]


def _stands(
    guards: Evaluator, guard: Expression | GuardWithActions, values: Mapping[str, bool]
) -> bool:
    """The value of a guard when conditions have these values and all actions have succeeded."""
    if isinstance(guard, Expression):
        return guards.holds(guard, _holding(values))
    done = dict.fromkeys((node.subject for node in guards.tree.actions()), Status.SUCCESS)
    return guards.status_at(guard.node, OwnFacts(_holding(values), done)) is not guard.wanted


def _effect(condition: str, value: bool) -> str:
    return f"{condition} to {str(value).lower()}"


def _holding(values: Mapping[str, bool]) -> set[str]:
    return {name for name, value in values.items() if value}


# -- reasons of failures that cannot be ---------------------------------------------------------


def _reasons_of_nothing(mission: Mission) -> Iterator[str]:
    ends = [
        (node.subject, need.local_task)
        for node in mission.tree.actions()
        for need in mission.global_tasks[node.subject].needs
    ]
    read = {n.subject: n for n in reversed(mission.tree.nodes) if n.kind is Kind.CONDITION}
    for name, node in sorted(read.items(), key=lambda item: item[1].index):
        declared = mission.conditions[type_name(name)]
        if declared.failure is None:
            continue
        told = (declared.after_end(*end, success=True, reason="") for end in ends)
        if all(each is None or each[0] != name for each in told):
            task = declared.failure.task
            yield (
                f"{_place(mission, node)}: {name} never holds: it tells why {task} failed, and the "
                "tree asks for nothing of that with these arguments"
            )


# -- words ------------------------------------------------------------------------------------


def _place(mission: Mission, node: Node) -> str:
    """`Sequence/Fallback[2]`: the nodes on the way down."""
    spec = mission.tree.spec(0)
    path = root_path(spec)
    for _, position in reversed(list(_ways_down(mission, node))):
        path = child_path(path, spec, position)
        spec = spec.children[position]
    return path


def _listed(names: Sequence[str]) -> str:
    more = [f"{len(names) - MAX_NAMED} more"] if len(names) > MAX_NAMED else []
    return " or ".join([*names[:MAX_NAMED], *more])
