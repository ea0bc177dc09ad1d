"""Tick rules of the decorators."""

from __future__ import annotations

import json
from typing import Any

from tests.support.btcpp.interpreter_base import (
    COMPLETED,
    FAILURE,
    IDLE,
    MAX_LOOPS,
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
    reset,
)


def _child(node: Node, world: World) -> Status:
    """Tick the one child; it is IDLE again once it has completed."""
    if len(node.children) != 1:
        raise TickError(f"{node.kind} has {len(node.children)} children, not 1")
    node.status = RUNNING
    status = execute(node.children[0], world)
    if status in COMPLETED:
        reset(node.children[0], world)
    return status


def _inverter(node: Node, world: World) -> Status:
    status = _child(node, world)
    return {SUCCESS: FAILURE, FAILURE: SUCCESS}.get(status, status)


def _force_success(node: Node, world: World) -> Status:
    status = _child(node, world)
    return SUCCESS if status in COMPLETED else status


def _force_failure(node: Node, world: World) -> Status:
    status = _child(node, world)
    return FAILURE if status in COMPLETED else status


def _again(node: Node, world: World) -> Status:
    """RetryUntilSuccessful and Repeat; the count survives a skipped child."""
    is_retry = node.kind == "RetryUntilSuccessful"
    limit_port = "num_attempts" if is_retry else "num_cycles"
    goes_on, ends = (FAILURE, SUCCESS) if is_retry else (SUCCESS, FAILURE)
    for _ in range(MAX_LOOPS):
        limit = int(port(node, limit_port, None, world))
        if limit != -1 and node.count >= limit:
            node.count = 0
            return goes_on
        was_idle = node.children[0].status is IDLE
        status = _child(node, world)
        if status in (RUNNING, SKIPPED):
            return status
        if status is ends:
            node.count = 0
            return status
        node.count += 1
        if world.yields and was_idle and (limit == -1 or node.count < limit):
            world.woken = True
            return RUNNING
    raise TickError(f"{node.kind} does not end within one tick")


def _keep_running(node: Node, world: World) -> Status:
    return FAILURE if _child(node, world) is FAILURE else RUNNING


def _timeout(node: Node, world: World) -> Status:
    child = node.children[0]
    limit_ms = int(port(node, "msec", None, world))
    deadline_ms = node.memory.setdefault("deadline_ms", world.now_ms + limit_ms)
    if limit_ms > 0 and child.status is RUNNING and world.now_ms >= deadline_ms:
        reset(child, world)
        del node.memory["deadline_ms"]
        return FAILURE
    status = _child(node, world)
    if status is not RUNNING:
        del node.memory["deadline_ms"]
    return status


def _delay(node: Node, world: World) -> Status:
    wait_ms = int(port(node, "delay_msec", None, world))
    ready_ms = node.memory.setdefault("ready_ms", world.now_ms + wait_ms)
    if world.now_ms < ready_ms:
        return RUNNING
    status = _child(node, world)
    if status is not RUNNING:
        del node.memory["ready_ms"]
    return status


def _run_once(node: Node, world: World) -> Status:
    if "once" in node.memory:
        return SKIPPED if is_true(port(node, "then_skip", True, world)) else node.memory["once"]
    status = _child(node, world)
    if status in COMPLETED:
        node.memory["once"] = status
    return status


def _precondition(node: Node, world: World) -> Status:
    """The condition is asked for again only once the child no longer runs."""
    if node.children[0].status is not RUNNING and not world.run(node.ports["if"]):
        return _status(port(node, "else", FAILURE, world))
    return _child(node, world)


def _status(value: Any) -> Status:
    return Status[value] if isinstance(value, str) else Status(value)


def _items(kind: str, text: str) -> list[Any]:
    """A constant queue: JSON, or items separated by `;`."""
    if text.startswith("json:"):
        return list(json.loads(text[5:]))
    read = {"LoopInt": int, "LoopDouble": float, "LoopBool": is_true, "LoopString": str}[kind]
    return [read(item.strip() if read is not str else item) for item in text.split(";") if item]


def _loop(node: Node, world: World) -> Status:
    """LoopInt and its kin: each item of the queue is put into `value`, then the child ticked."""
    if "queue" not in node.memory:
        queue = node.ports.get("queue")
        is_pointer = isinstance(queue, str) and queue.startswith("{")
        if isinstance(queue, str) and not is_pointer:
            queue = _items(node.kind, queue)
        # A queue on the blackboard is consumed there; a constant one is copied at every start.
        node.memory["queue"] = None if is_pointer else list(queue or ())
    child = node.children[0]
    if child.status is not RUNNING:
        items = node.memory["queue"]
        if items is None:
            items = port(node, "queue", None, world)
        if not items:
            del node.memory["queue"]
            return _status(port(node, "if_empty", SUCCESS, world))
        target = str(node.ports["value"])
        world.blackboard[target.strip("{}")] = items.pop(0)
    if _child(node, world) is FAILURE:
        del node.memory["queue"]
        return FAILURE
    return RUNNING


def _updated(node: Node, world: World) -> Status:
    """SkipUnlessUpdated and WaitValueUpdate: tick the child once per write of the entry."""
    if node.children[0].status is not RUNNING and not was_updated(node, world):
        return SKIPPED if node.kind == "SkipUnlessUpdated" else RUNNING
    return _child(node, world)


def was_updated(node: Node, world: World) -> bool:
    """Whether the entry was written since this node asked last."""
    entry = str(node.ports["entry"]).strip("{}")
    writes = world.blackboard.writes.get(entry, 0) if entry in world.blackboard else 0
    if not writes:
        return False
    seen = node.memory.get("seen", 0)
    node.memory["seen"] = writes
    return bool(seen != writes)


def _transparent(node: Node, world: World) -> Status:
    return _child(node, world)


TICKS |= {
    "Inverter": _inverter,
    "ForceSuccess": _force_success,
    "ForceFailure": _force_failure,
    "RetryUntilSuccessful": _again,
    "Repeat": _again,
    "KeepRunningUntilFailure": _keep_running,
    "Timeout": _timeout,
    "Delay": _delay,
    "RunOnce": _run_once,
    "Precondition": _precondition,
    "LoopInt": _loop,
    "LoopBool": _loop,
    "LoopDouble": _loop,
    "LoopString": _loop,
    "SkipUnlessUpdated": _updated,
    "WaitValueUpdate": _updated,
    "SubTree": _transparent,
}
