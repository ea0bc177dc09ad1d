"""Carries out one local task by its function: what its result means, and the record of its work."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

from mrbt_mesh.core.mission.conditions import truth_of
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.runtime.task_port import AgentPort
from mrbt_mesh.runtime.user_code import UserCall, UserCodeError, failure_of, wrong_result

EXPECTED = (
    "return None or True for success, False for failure, "
    "or {condition: bool} for success with conditions"
)


async def perform(call: UserCall, task: TaskContext, port: AgentPort, is_recorded: bool) -> bool:
    """Whether the local task has succeeded, by its function's result.

    `is_recorded`: its start, and its end or cancellation, are lines of the run's events. Raises
    UserCodeError for whatever the function raised, and for a result that means nothing.
    """
    outcome = None
    if is_recorded:
        _record(task, "start")
    try:
        success = _succeeded(await call.run(), call.function, port)
        outcome = "success" if success else "failure"
    except UserCodeError:
        outcome = "failure"
        raise
    except Exception as error:  # of a result that cannot even be looked at
        outcome = "failure"
        raise failure_of(error, call.function) from None
    finally:
        if is_recorded:
            _record(task, "end" if outcome else "cancel", outcome)
    return success


def _succeeded(result: Any, function: Callable[..., Any], port: AgentPort) -> bool:
    """What a result means; sets the conditions of a mapping. Raises UserCodeError."""
    if result is None:
        return True
    truth = truth_of(result)
    if truth is not None:
        return truth
    if isinstance(result, Mapping):
        try:
            port.set_conditions(result)
        except ValueError as error:
            raise wrong_result(function, result, str(error)) from None
        return True
    # NodeStatus and py_trees' Status: members of trees' leaves that became local tasks.
    ended = str(result.name) if isinstance(result, Enum) else ""
    if ended in ("SUCCESS", "FAILURE"):
        return ended == "SUCCESS"
    raise wrong_result(function, result, EXPECTED)


def _record(task: TaskContext, event: str, outcome: str | None = None) -> None:
    task.record_event(
        {
            "t": task.unix_time_s(),
            "robot": task.robot,
            "pid": task.simulation.pid,
            "incarnation": task.incarnation,
            "event": event,
            "outcome": outcome,
            "activation": task.activation,
            "global_task": task.global_task,
            "local_task": type_name(task.local_task),
            "args": list(task.arguments),
        }
    )
