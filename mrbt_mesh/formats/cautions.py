"""Warnings about missions that are valid but unlikely to do what was meant.

1. A Fallback that waits for ever. An action that no living robot can do, and at which no robot has
   failed, is blocked; with `blocked: wait` it never fails, so that the Fallback above it never
   tries its next child.
2. Actions that undo what led to them. If an action's effect turns a condition that an earlier child
   of a Sequence checks, its success makes that child run again, and then the action itself.
3. Failure conditions of tasks that the tree never requests: they never hold.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

from mrbt_mesh.core.bt.evaluation import OwnFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import Expression, GuardWithActions
from mrbt_mesh.core.bt.tree import Kind, Node, Status, Tree
from mrbt_mesh.core.mission.mission import GlobalTask, Mission
from mrbt_mesh.core.mission.names import declared_name, type_name
from mrbt_mesh.formats.node_paths import child_path, root_path

MAX_NAMED = 3
# Guards with more conditions are not tried out; they are assumed to change.
MAX_CONDITIONS = 8


def cautions(mission: Mission) -> list[str]:
    """Return all warnings as lines for people, each kind in tree order."""
    return [
        *_stuck_fallbacks(mission),
        *_undoing_actions(mission),
        *_conditions_that_never_hold(mission),
    ]


# -- Fallbacks that wait for ever ---------------------------------------------------------------


def _stuck_fallbacks(mission: Mission) -> Iterator[str]:
    tasks = _tasks(mission)
    for node in mission.tree.nodes:
        if node.kind is not Kind.FALLBACK:
            continue
        waiting: dict[str, None] = {}
        for child in node.children[:-1]:
            names = dict.fromkeys(_waiting_for_ever(mission.tree, child, tasks))
            if names and _possible_ends(mission.tree, child)[1]:
                waiting.update(names)
        if waiting:
            yield (
                f"{_place(mission, node)}: this Fallback waits for ever if no living robot can do "
                f"{_listed(list(waiting))}; add blocked: {{fail_after_s: 20}}, there or at the top "
                "of the file, to try the next child after that time"
            )


def _possible_ends(tree: Tree, index: int) -> tuple[bool, bool]:
    """Return whether a node can succeed and whether it can fail if there are robots for every task.

    Conditions may have any value each time they are read, so children do not depend on each other.
    """
    node = tree.nodes[index]
    children = [_possible_ends(tree, child) for child in node.children]
    succeeds = [can_succeed for can_succeed, _ in children]
    fails = [can_fail for _, can_fail in children]
    match node.kind:
        case Kind.ACTION | Kind.CONDITION | Kind.JOBS:
            return True, True
        case Kind.SEQUENCE:
            return all(succeeds), _reached(fails, succeeds)
        case Kind.FALLBACK:
            return _reached(succeeds, fails), all(fails)
        case Kind.PARALLEL:
            tolerated = node.failures or len(children) - node.limit + 1
            return sum(succeeds) >= node.limit, sum(fails) >= tolerated
        case Kind.IF_THEN_ELSE:
            then, otherwise = children[1], (*children[2:], (False, True))[0]
            return (
                (succeeds[0] and then[0]) or (fails[0] and otherwise[0]),
                (succeeds[0] and then[1]) or (fails[0] and otherwise[1]),
            )
        case _:
            return _decorated_ends(tree, node, *children[0])


def _decorated_ends(tree: Tree, node: Node, can_succeed: bool, can_fail: bool) -> tuple[bool, bool]:
    """Return whether a node with one child can succeed and whether it can fail."""
    match node.kind:
        case Kind.INVERTER:
            return can_fail, can_succeed
        case Kind.FORCE_SUCCESS:
            return can_succeed or can_fail, False
        case Kind.FORCE_FAILURE:
            return False, can_succeed or can_fail
        case Kind.RETRY:
            return can_succeed, can_fail and node.limit >= 0
        case Kind.REPEAT:
            return can_succeed and node.limit >= 0, can_fail
        case Kind.KEEP_RUNNING_UNTIL_FAILURE:
            return False, can_fail
        case Kind.TIMEOUT:  # an action may take too long
            return can_succeed, can_fail or tree.containing(Kind.ACTION)[node.index]
        case _:
            return can_succeed, can_fail


def _reached(ends: Sequence[bool], leads_on: Sequence[bool]) -> bool:
    """True if some child can end this way after every child before it has led on to it."""
    return any(end and all(leads_on[:position]) for position, end in enumerate(ends))


def _waiting_for_ever(tree: Tree, index: int, tasks: Mapping[str, GlobalTask]) -> Iterator[str]:
    """Yield the tasks at or below a node that wait while blocked and that no Timeout ends."""
    node = tree.nodes[index]
    if node.kind is Kind.ACTION:
        if tasks[node.subject].blocked_fail_after_us is None:
            yield node.subject
    elif node.kind not in (Kind.TIMEOUT, Kind.JOBS):
        for child in node.children:
            yield from _waiting_for_ever(tree, child, tasks)


def _tasks(mission: Mission) -> dict[str, GlobalTask]:
    """Return all tasks by name. Tasks of jobs with the same placeholders are the same."""
    return {task.id: task for task in mission.all_tasks()}


# -- actions that undo what led to them -------------------------------------------------------


def _undoing_actions(mission: Mission) -> Iterator[str]:
    guards, tasks = mission.evaluator, _tasks(mission)
    for node in mission.tree.actions():
        effects = dict(tasks[node.subject].effects)
        for parent, position in _ways_down(mission, node) if effects else ():
            turned = _turned_against(guards, parent, position, effects)
            if parent.kind is Kind.SEQUENCE and turned:
                yield (
                    f"{_place(mission, node)} sets {_listed(turned)}, but an earlier child of "
                    f"{_place(mission, parent)} checks the opposite: once the action has "
                    "succeeded, the Sequence starts again; give it memory: while_running, or set "
                    "the condition after it"
                )


def _turned_against(
    guards: Evaluator, parent: Node, position: int, effects: Mapping[str, bool]
) -> list[str]:
    """Return the effects of an action at or below a child that keep this child from being
    reached.
    """
    found: dict[str, None] = {}
    for left in range(1, position + 1):
        for name, against in guards.read_before(parent, left):
            found.update(dict.fromkeys(_turned_by(guards, name, against, effects)))
    return list(found)


def _ways_down(mission: Mission, node: Node) -> Iterator[tuple[Node, int]]:
    """Yield the ancestors, nearest first, each with the position of the child that leads down."""
    nodes = mission.tree.nodes
    while node.parent >= 0:
        parent = nodes[node.parent]
        yield parent, parent.children.index(node.index)
        node = parent


def _turned_by(
    guards: Evaluator, name: str, against: bool, effects: Mapping[str, bool]
) -> list[str]:
    """Return effects that can change a guard to the value with which the action is not reached."""
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
            turns = [_value(guards, guard, values) is against for values in (before, after)]
            if turns == [False, True]:
                break
        else:
            return []
    return [_effect(condition, effects[condition]) for condition in read]


def _value(
    guards: Evaluator, guard: Expression | GuardWithActions, values: Mapping[str, bool]
) -> bool:
    """Return a guard's value with these conditions, assuming that all actions have succeeded."""
    if isinstance(guard, Expression):
        return guards.holds(guard, _holding(values))
    done = dict.fromkeys((node.subject for node in guards.tree.actions()), Status.SUCCESS)
    return guards.status_at(guard.node, OwnFacts(_holding(values), done)) is not guard.wanted


def _effect(condition: str, value: bool) -> str:
    return f"{condition} to {str(value).lower()}"


def _holding(values: Mapping[str, bool]) -> set[str]:
    return {name for name, value in values.items() if value}


# -- failure conditions that never hold ---------------------------------------------------------


def _conditions_that_never_hold(mission: Mission) -> Iterator[str]:
    pairs = [(task.id, need.local_task) for task in mission.all_tasks() for need in task.needs]
    ends = [pair for pair in pairs if not any(map(_of_job, pair))]
    # Their ground names are known only once there is a job.
    of_jobs = {type_name(name) for pair in pairs for name in pair if _of_job(name)}
    read = {n.subject: n for n in reversed(mission.tree.nodes) if n.kind is Kind.CONDITION}
    for name, node in sorted(read.items(), key=lambda item: item[1].index):
        declared = mission.conditions[declared_name(name)]
        if declared.failure is None or declared.failure.task in of_jobs or _of_job(name):
            continue
        set_by_ends = (declared.after_end(*end, success=True, reason="") for end in ends)
        if all(each is None or each[0] != name for each in set_by_ends):
            task = declared.failure.task
            yield (
                f"{_place(mission, node)}: {name} never holds: it is about a failure of {task}, "
                "which the tree does not request with these arguments"
            )


def _of_job(name: str) -> bool:
    return "{" in name


# -- words ------------------------------------------------------------------------------------


def _place(mission: Mission, node: Node) -> str:
    """Return the names of the nodes from the root to `node`, as `Sequence/Fallback[2]`."""
    spec = mission.tree.spec(0)
    path = root_path(spec)
    for _, position in reversed(list(_ways_down(mission, node))):
        path = child_path(path, spec, position)
        spec = spec.children[position]
    return path


def _listed(names: Sequence[str]) -> str:
    more = [f"{len(names) - MAX_NAMED} more"] if len(names) > MAX_NAMED else []
    return " or ".join([*names[:MAX_NAMED], *more])
