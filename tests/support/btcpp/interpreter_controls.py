"""Tick rules of the control nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tests.support.btcpp.interpreter_base import (
    BEFORE_HALT,
    COMPLETED,
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    TICKS,
    Node,
    Status,
    TickError,
    World,
    execute,
    is_true,
    port,
    reset_all,
)


def _in_order(node: Node, world: World) -> Status:
    """Sequence and Fallback with their Async and Memory forms: go on where it stopped."""
    is_sequence = "Sequence" in node.kind
    goes_on, ends = (SUCCESS, FAILURE) if is_sequence else (FAILURE, SUCCESS)
    if node.status is not RUNNING:
        node.skipped = 0
    node.status = RUNNING
    while node.index < len(node.children):
        child = node.children[node.index]
        was_idle = child.status is IDLE
        status = execute(child, world)
        if status is RUNNING:
            return RUNNING
        if status is ends:
            if node.kind == "SequenceWithMemory":
                reset_all(node.children[node.index :], world)
            else:
                reset_all(node.children, world)
                node.index = 0
            return status
        node.index += 1
        node.skipped += status is SKIPPED
        is_last = node.index == len(node.children)
        if node.kind.startswith("Async") and status is goes_on and was_idle and not is_last:
            world.woken = True
            return RUNNING
    reset_all(node.children, world)
    node.index = 0
    return SKIPPED if node.skipped == len(node.children) else goes_on


def _reactive(node: Node, world: World) -> Status:
    goes_on, ends = (SUCCESS, FAILURE) if node.kind == "ReactiveSequence" else (FAILURE, SUCCESS)
    node.status = RUNNING
    skipped = 0
    for child in node.children:
        status = execute(child, world)
        if status is RUNNING:
            reset_all([other for other in node.children if other is not child], world)
            return RUNNING
        if status is ends:
            reset_all(node.children, world)
            return status
        skipped += status is SKIPPED
    reset_all(node.children, world)
    return SKIPPED if skipped == len(node.children) else goes_on


def _threshold(node: Node, name: str, default: int, world: World) -> tuple[int, int]:
    """A threshold as given, and with a negative one counted from the number of children."""
    given = int(port(node, name, default, world))
    count = len(node.children)
    if given > count:
        raise TickError(f"{node.kind}: {name} {given} is above the number of children {count}")
    return given, given if given >= 0 else max(count + given + 1, 0)


def _parallel(node: Node, world: World) -> Status:
    given, needed = _threshold(node, "success_count", -1, world)
    _, allowed = _threshold(node, "failure_count", 1, world)
    node.status = RUNNING
    done: dict[int, Status] = node.memory.setdefault("done", {})
    skipped = 0
    for index, child in enumerate(node.children):
        if index not in done:
            status = execute(child, world)
            if status in COMPLETED:
                done[index] = status
            skipped += status is SKIPPED
        successes = sum(status is SUCCESS for status in done.values())
        failures = len(done) - successes
        result = None
        if successes >= needed or (given < 0 and successes + skipped >= needed):
            result = SUCCESS
        elif len(node.children) - failures < needed or failures == allowed:
            result = FAILURE
        if result is not None:
            done.clear()
            reset_all(node.children, world)
            return result
    return SKIPPED if skipped == len(node.children) else RUNNING


def _parallel_all(node: Node, world: World) -> Status:
    _, allowed = _threshold(node, "max_failures", 1, world)
    node.status = RUNNING
    done: dict[int, Status] = node.memory.setdefault("done", {})
    skipped = 0
    for index, child in enumerate(node.children):
        if index not in done:
            status = execute(child, world)
            if status in COMPLETED:
                done[index] = status
            skipped += status is SKIPPED
    if skipped == len(node.children):
        return SKIPPED
    if skipped + len(done) < len(node.children):
        return RUNNING
    failures = sum(status is FAILURE for status in done.values())
    done.clear()
    reset_all(node.children, world)
    return FAILURE if failures >= allowed else SUCCESS


def _expect(node: Node, counts: Sequence[int]) -> None:
    if len(node.children) not in counts:
        raise TickError(f"{node.kind} has {len(node.children)} children, not one of {counts}")


def _if_then_else(node: Node, world: World) -> Status:
    _expect(node, (2, 3))
    node.status = RUNNING
    if node.index == 0:
        status = execute(node.children[0], world)
        if status is RUNNING:
            return RUNNING
        if status is SKIPPED:
            raise TickError("IfThenElse: the condition was skipped")
        if status is FAILURE and len(node.children) == 2:
            reset_all(node.children, world)
            return FAILURE
        node.index = 1 if status is SUCCESS else 2
    status = execute(node.children[node.index], world)
    if status is not RUNNING:
        reset_all(node.children, world)
        node.index = 0
    return status


def _while_do_else(node: Node, world: World) -> Status:
    _expect(node, (2, 3))
    node.status = RUNNING
    condition = execute(node.children[0], world)
    if condition is RUNNING:
        return RUNNING
    if condition is SKIPPED:
        raise TickError("WhileDoElse: the condition was skipped")
    branches = list(node.children[1:])
    chosen = 0 if condition is SUCCESS else 1
    reset_all([branch for index, branch in enumerate(branches) if index != chosen], world)
    status = execute(branches[chosen], world) if chosen < len(branches) else FAILURE
    if status is not RUNNING:
        reset_all(node.children, world)
    return status


def _switch(node: Node, world: World) -> Status:
    cases = int(node.kind[6:])
    _expect(node, (cases + 1,))
    variable = port(node, "variable", None, world)
    chosen = cases
    for index in range(cases):
        case = port(node, f"case_{index + 1}", None, world)
        if variable is not None and case is not None and _same(variable, case):
            chosen = index
            break
    node.status = RUNNING
    reset_all([child for index, child in enumerate(node.children) if index != chosen], world)
    status = execute(node.children[chosen], world)
    if status is not RUNNING:
        reset_all(node.children, world)
    return status


def _same(variable: Any, case: Any) -> bool:
    """Equal texts, or equal numbers."""
    if str(variable) == str(case):
        return True
    try:
        return float(variable) == float(case)
    except ValueError:
        return False


def _try_catch(node: Node, world: World) -> Status:
    if len(node.children) < 2:
        raise TickError("TryCatch needs at least 2 children")
    if node.status is not RUNNING:
        node.skipped = 0
    node.status = RUNNING
    *attempt, catch = node.children
    while "in_catch" not in node.memory:
        if node.index == len(attempt):
            reset_all(node.children, world)
            node.index = 0
            return SKIPPED if node.skipped == len(attempt) else SUCCESS
        status = execute(attempt[node.index], world)
        if status is RUNNING:
            return RUNNING
        if status is FAILURE:
            reset_all(node.children, world)
            node.memory["in_catch"] = True
        node.index += 1
        node.skipped += status is SKIPPED
    if execute(catch, world) is RUNNING:
        return RUNNING
    reset_all(node.children, world)
    node.index = 0
    del node.memory["in_catch"]
    return FAILURE


def _catch_on_halt(node: Node, world: World) -> None:
    wanted = is_true(port(node, "catch_on_halt", False, world))
    if wanted and "in_catch" not in node.memory:
        reset_all(node.children[:-1], world)
        execute(node.children[-1], world)


TICKS |= {
    "Sequence": _in_order,
    "AsyncSequence": _in_order,
    "SequenceWithMemory": _in_order,
    "Fallback": _in_order,
    "AsyncFallback": _in_order,
    "ReactiveSequence": _reactive,
    "ReactiveFallback": _reactive,
    "Parallel": _parallel,
    "ParallelAll": _parallel_all,
    "IfThenElse": _if_then_else,
    "WhileDoElse": _while_do_else,
    "Switch": _switch,
    "TryCatch": _try_catch,
}
BEFORE_HALT["TryCatch"] = _catch_on_halt
