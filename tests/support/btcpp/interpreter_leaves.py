"""Tick rules of the leaves."""

from __future__ import annotations

from tests.support.btcpp.interpreter_base import (
    FAILURE,
    RUNNING,
    SUCCESS,
    TICKS,
    Node,
    Status,
    World,
    port,
)
from tests.support.btcpp.interpreter_decorators import was_updated


def _scripted(node: Node, world: World) -> Status:
    node.ticks += 1
    if callable(node.script):
        return node.script()
    return node.script[min(node.ticks, len(node.script)) - 1]


def _always_success(node: Node, world: World) -> Status:
    return SUCCESS


def _always_failure(node: Node, world: World) -> Status:
    return FAILURE


def _script(node: Node, world: World) -> Status:
    world.run(node.ports["code"])
    return SUCCESS


def _script_condition(node: Node, world: World) -> Status:
    return SUCCESS if world.run(node.ports["code"]) else FAILURE


def _set_blackboard(node: Node, world: World) -> Status:
    key = str(node.ports["output_key"]).strip("{}")
    world.blackboard[key] = port(node, "value", "", world)
    return SUCCESS


def _unset_blackboard(node: Node, world: World) -> Status:
    world.blackboard.pop(str(node.ports["key"]).strip("{}"), None)
    return SUCCESS


def _sleep(node: Node, world: World) -> Status:
    until_ms = node.memory.setdefault(
        "until_ms", world.now_ms + int(port(node, "msec", None, world))
    )
    if world.now_ms < until_ms:
        return RUNNING
    del node.memory["until_ms"]
    return SUCCESS


def _was_entry_updated(node: Node, world: World) -> Status:
    return SUCCESS if was_updated(node, world) else FAILURE


TICKS |= {
    "Action": _scripted,
    "Condition": _scripted,
    "AlwaysSuccess": _always_success,
    "AlwaysFailure": _always_failure,
    "Script": _script,
    "ScriptCondition": _script_condition,
    "SetBlackboard": _set_blackboard,
    "UnsetBlackboard": _unset_blackboard,
    "Sleep": _sleep,
    "WasEntryUpdated": _was_entry_updated,
}
