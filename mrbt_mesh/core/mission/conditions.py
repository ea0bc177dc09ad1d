"""Conditions, and those that every robot has for itself (`per: robot`), such as *holding*.

There is one ground condition per robot of the mission: `holding@A1`. A leaf `holding` of T_G holds
if it holds for at least one of them; its turns are counted like those of any expression of
conditions (`bt.guards`), and a request behind it is for the robots for which it holds.

Entries of the team's blackboard that hold other values are declared alike. The tree reads them with
comparisons, which are conditions to it (`blackboard`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mrbt_mesh.core.bt.activation import ActivationNames
from mrbt_mesh.core.bt.guards import Expression, Guard
from mrbt_mesh.core.bt.tree import Kind, NodeSpec
from mrbt_mesh.core.mission.blackboard import Value, ValueType, comparison_of
from mrbt_mesh.core.mission.failure_reasons import FailureReason
from mrbt_mesh.core.mission.names import (
    declared_name,
    is_job_id,
    owning_job,
    robot_condition,
    split_owner,
)


@dataclass(frozen=True, slots=True)
class ConditionType:
    """A declared condition, or another entry of the blackboard with `values`; `default` is the
    value of a ground one that nobody has set, None if it has none.

    `per_robot`: every robot of the mission has its own, `per_job`: every job. `failure`: it follows
    from failure reasons, and robots' programs do not set it.
    """

    name: str
    parameters: tuple[str, ...] = ()
    default: Value | None = False
    per_robot: bool = False
    failure: FailureReason | None = None
    values: ValueType | None = None
    per_job: bool = False

    def to_json(self) -> list[Any]:
        """Its fields in their order; the last ones only where they differ from the usual."""
        row = [list(self.parameters), self.default]
        if self.values is not None:
            return [*row, self.per_robot, None, self.values.to_json(), self.per_job]
        if self.failure is not None:
            return [*row, self.per_robot, self.failure.to_json()]
        return [*row, True] if self.per_robot else row

    def after_end(
        self, global_task: str, local_task: str, success: bool, reason: str
    ) -> tuple[str, bool] | None:
        """The ground condition that an outcome sets, and its value; None: none."""
        if self.failure is None:
            return None
        arguments = self.failure.bind(self.parameters, global_task, local_task)
        if arguments is None:
            return None
        name = f"{self.name}({','.join(arguments)})" if arguments else self.name
        return name, not success and self.failure.fits(reason)


def conditions_from_json(data: Mapping[str, Any]) -> dict[str, ConditionType]:
    """Read them from a compiled mission; raises TypeError or ValueError for anything else."""
    return {name: _condition_from_json(name, row) for name, row in data.items()}


def _condition_from_json(name: str, row: list[Any]) -> ConditionType:
    parameters, *more = row
    usual: list[Any] = [False, False, None, None, False]
    default, per_robot, failure, values, per_job = more + usual[len(more) :]
    reason = None if failure is None else FailureReason.from_json(failure)
    kind = None if values is None else ValueType(tuple(values[0]), *values[1:])
    return ConditionType(name, tuple(parameters), default, per_robot, reason, kind, per_job)


def any_of(condition: str, robots: Iterable[str]) -> Expression:
    """Whether a condition holds for any of the robots, as a leaf reads it. Its id is its name."""
    names = tuple(sorted(robot_condition(condition, robot) for robot in robots))
    leaves = tuple(NodeSpec(Kind.CONDITION, subject=name) for name in names)
    return Expression(condition, NodeSpec(Kind.FALLBACK, leaves), names)


def entry_reader(comparison: str, entry: str) -> Expression:
    """A comparison, as a leaf reads it. Its id is its name, and it follows from one entry."""
    return Expression(comparison, NodeSpec(Kind.CONDITION, subject=comparison), (entry,))


class PerRobotConditions:
    """The conditions that every robot has for itself, and the nodes of the tree that read them.

    `robots`: those of the mission, sorted.
    """

    def __init__(
        self, declared: Mapping[str, ConditionType], robots: Sequence[str], names: ActivationNames
    ) -> None:
        self.robots = robots
        self._declared = declared
        self._names = names

    def __contains__(self, ground: str) -> bool:
        """Whether every robot has its own value of a condition, by the name that a leaf reads."""
        known = self._declared.get(declared_name(ground))
        return known is not None and known.per_robot and not split_owner(ground)[1]

    def names_owner(self, name: str) -> bool:
        """Whether a condition is of the team, of a robot, or of a job, as it must: `holding@A1`."""
        condition, owner = split_owner(name)
        known = self._declared.get(declared_name(name))
        if known is not None and known.per_job:
            return is_job_id(owning_job(name))
        return owner in self.robots if condition in self else name == condition

    @cached_property
    def leaves(self) -> list[str]:
        """Those that the tree reads, sorted."""
        nodes = self._names.tree.nodes
        return sorted({n.subject for n in nodes if n.kind is Kind.CONDITION and n.subject in self})

    @cached_property
    def read(self) -> list[str]:
        """The conditions and entries that these leaves read, sorted."""
        comparisons = ((leaf, comparison_of(leaf)) for leaf in self.leaves)
        return sorted({leaf if each is None else each.entry for leaf, each in comparisons})

    @cached_property
    def guard_expressions(self) -> dict[str, Expression]:
        """The expressions that are guards, by id; also conditions of any robot, and comparisons."""
        leaves = {name: any_of(name, self.robots) for name in self.leaves}
        if all(known.values is None for known in self._declared.values()):
            return self._names.expressions | leaves
        nodes = self._names.tree.nodes
        subjects = {node.subject for node in nodes if node.kind is Kind.CONDITION} - leaves.keys()
        subjects.update(name for leaf in leaves.values() for name in leaf.conditions)
        pairs = ((name, comparison_of(name)) for name in sorted(subjects))
        readers = {name: entry_reader(name, each.entry) for name, each in pairs if each is not None}
        return self._names.expressions | leaves | readers

    def read_by(self, guard: str) -> tuple[str, ...]:
        """The conditions that a guard of several nodes reads, as the tree names them."""
        known = self._names.with_actions.get(guard)
        if known is not None:
            return known.conditions
        return (guard,) if guard in self else self.guard_expressions[guard].conditions

    @cached_property
    def guards(self) -> dict[int, tuple[Guard, ...]]:
        """By action node: its guards that a robot reads its own way; nodes without are left out.

        Of guards with actions only Sequences and Fallbacks are read with a robot's own values.
        """
        nodes, in_order = self._names.tree.nodes, (Kind.SEQUENCE, Kind.FALLBACK)
        with_actions = self._names.with_actions.items()
        asking = {name: each for name, each in with_actions if nodes[each.node].kind in in_order}
        own = {
            name
            for name, each in (self.guard_expressions | asking).items()
            if name in self or any(condition in self for condition in each.conditions)
        }
        if not own:
            return {}
        found = {}
        for node in self._names.tree.actions():
            guards = tuple(g for g in self._names.guards_of[node.index] if g[0] in own)
            if guards:
                found[node.index] = guards
        return found


def truth_of(value: Any) -> bool | None:
    """A truth value of a robot's program, Python's or numpy's bool; None: it is none."""
    if isinstance(value, bool):
        return value
    kind = type(value)
    is_numpy = kind.__module__ == "numpy" and kind.__name__ in ("bool", "bool_")
    return bool(value) if is_numpy else None
