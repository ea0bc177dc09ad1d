"""Conditions of the team as leaves of the trees that a robot's program runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mrbt_mesh.btcpp import Leaves
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.runtime.program import TaskContext


def team_leaves(leaves: Leaves, conditions: Mapping[str, ConditionType]) -> Leaves:
    """A program's leaves, and conditions of the team for which it has no function.

    Their ports are the condition's arguments, by name or, where names differ, in their order.
    """
    return leaves.with_conditions({name: _asked(each) for name, each in conditions.items()})


def _asked(condition: ConditionType) -> Callable[..., bool]:
    def ask(_task: TaskContext, **ports: Any) -> bool:
        is_named = ports.keys() == set(condition.parameters)
        values = [ports[name] for name in condition.parameters] if is_named else ports.values()
        arguments = ",".join(map(str, values))
        return _task.condition(f"{condition.name}({arguments})" if arguments else condition.name)

    ask.__annotations__["_task"] = TaskContext
    return ask
