"""What names mean in a mission with values on a blackboard, or conditions of each robot.

There is one ground condition per robot of the mission: `holding@A1`. A leaf `holding` of T_G holds
if it holds for at least one of them; its turns are counted like those of any expression of
conditions (`bt.guards`), and a request behind it is for the robots for which it holds.

Entries of the team's blackboard that hold other values are declared alike. The tree reads them with
comparisons, which are conditions to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

from mrbt_mesh.core.bt.activation import ActivationNames
from mrbt_mesh.core.bt.guards import Expression, Guard
from mrbt_mesh.core.bt.tree import Kind, NodeSpec
from mrbt_mesh.core.mission.conditions import ConditionType, Value
from mrbt_mesh.core.mission.mission import MissionEntries
from mrbt_mesh.core.mission.names import (
    declared_name,
    is_job_id,
    job_entry,
    owning_job,
    robot_condition,
    split_owner,
)
from mrbt_mesh.features.values.blackboard import ValueType, comparison_of
from mrbt_mesh.features.values.traits import traits_of


def any_of(condition: str, robots: Iterable[str]) -> Expression:
    """Whether a condition holds for any of the robots, as a leaf reads it. Its id is its name."""
    names = tuple(sorted(robot_condition(condition, robot) for robot in robots))
    leaves = tuple(NodeSpec(Kind.CONDITION, subject=name) for name in names)
    return Expression(condition, NodeSpec(Kind.FALLBACK, leaves), names)


def entry_reader(comparison: str, entry: str) -> Expression:
    """A comparison, as a leaf reads it. Its id is its name, and it follows from one entry."""
    return Expression(comparison, NodeSpec(Kind.CONDITION, subject=comparison), (entry,))


class ValueEntries(MissionEntries):
    """See `MissionEntries`."""

    is_plain = False

    def __init__(
        self, declared: Mapping[str, ConditionType], robots: Sequence[str], names: ActivationNames
    ) -> None:
        super().__init__(declared, robots, names)
        self.has_values = not all(known.is_truth for known in declared.values())

    # -- names --------------------------------------------------------------------------------

    def is_condition(self, ground: str) -> bool:
        """See `MissionEntries`: a declared condition, or a comparison of an entry with a value that
        its type has.
        """
        comparison = comparison_of(ground) if self.has_values else None
        if comparison is None:
            return self.knows(ground) and not self.is_value(ground)
        if not self.can_be_set(comparison.entry) and not self.is_own(comparison.entry):
            return False
        try:
            self._compare(ground, 0)
        except (KeyError, TypeError, ValueError, AssertionError):
            return False
        return True

    def can_be_set(self, name: str) -> bool:
        """See `MissionEntries`: one of the team, of a robot (`holding@A1`), or of a job."""
        return self.knows(split_owner(name)[0]) and self._names_owner(name)

    def _names_owner(self, name: str) -> bool:
        """Whether a condition is of the team, of a robot, or of a job, as it must: `holding@A1`."""
        condition, owner = split_owner(name)
        known = self.declared.get(declared_name(name))
        if known is not None and traits_of(known).per_job:
            return is_job_id(owning_job(name))
        return owner in self.robots if self.is_own(condition) else name == condition

    def is_value(self, ground: str) -> bool:
        """See `MissionEntries`."""
        if not self.has_values:
            return False
        known = self.declared.get(declared_name(ground))
        return (
            known is not None
            and traits_of(known).values is not None
            and comparison_of(ground) is None
        )

    def is_own(self, ground: str) -> bool:
        """See `MissionEntries`."""
        known = self.declared.get(declared_name(ground))
        return known is not None and traits_of(known).per_robot and not split_owner(ground)[1]

    def of(self, robot: str, name: str, job: str = "") -> str:
        """See `MissionEntries`."""
        if self.is_own(name):
            return robot_condition(name, robot)
        if job and self.has_values:
            known = self.declared.get(declared_name(name))
            if known is not None and traits_of(known).per_job and not split_owner(name)[1]:
                return job_entry(name, job)
        return name

    def called(self, name: str) -> str:
        """See `MissionEntries`."""
        is_truth = self.declared[name].is_truth
        return super().called(name) if is_truth else f"entry {name} of the blackboard"

    # -- values -------------------------------------------------------------------------------

    def default(self, ground: str) -> bool:
        """See `MissionEntries`."""
        comparison = comparison_of(ground) if self.has_values else None
        if comparison is None:
            return bool(self.default_of(ground))
        return self._compare(ground, self.default_of(comparison.entry))

    def problem(self, name: str, value: Any) -> str:
        """See `MissionEntries`."""
        values = self._values_of(name)
        if values is None:
            return super().problem(name, value)
        return "" if value is None or values.fits(value) else f"it is {values}"

    def text(self, ground: str, value: Value | None) -> str:
        """See `MissionEntries`."""
        is_known = declared_name(ground) in self.declared
        values = self._values_of(ground) if value is not None and is_known else None
        if value is None or values is None:
            return super().text(ground, value)
        return values.text(value)

    def samples(self, name: str) -> Sequence[str]:
        """See `MissionEntries`."""
        values = self._values_of(name)
        return () if values is None else values.samples()

    def _values_of(self, name: str) -> ValueType | None:
        """What a declared entry holds; None: it is a condition."""
        return traits_of(self.declared[declared_name(name)]).values

    def _compare(self, comparison: str, value: Value | None) -> bool:
        """Whether a comparison holds if its entry has this value."""
        values, read = (
            traits_of(self.declared[declared_name(comparison)]).values,
            comparison_of(comparison),
        )
        assert values is not None
        assert read is not None
        return values.holds(read, value)

    def derived(
        self, name: str, holds: Callable[[str], bool], value: Callable[[str], Value | None]
    ) -> bool | None:
        """See `MissionEntries`."""
        if self.is_own(name):
            return any(holds(robot_condition(name, robot)) for robot in self.robots)
        comparison = comparison_of(name) if self.has_values else None
        return None if comparison is None else self._compare(name, value(comparison.entry))

    # -- the tree -----------------------------------------------------------------------------

    @cached_property
    def leaves(self) -> Sequence[str]:  # type: ignore[override]
        nodes = self.names.tree.nodes
        read = {node.subject for node in nodes if node.kind is Kind.CONDITION}
        return sorted(filter(self.is_own, read))

    @cached_property
    def read(self) -> Sequence[str]:  # type: ignore[override]
        comparisons = ((leaf, comparison_of(leaf)) for leaf in self.leaves)
        return sorted({leaf if each is None else each.entry for leaf, each in comparisons})

    @cached_property
    def expressions(self) -> Mapping[str, Expression]:
        """See `MissionEntries`: also conditions of any robot, and comparisons."""
        leaves = {name: any_of(name, self.robots) for name in self.leaves}
        if not self.has_values:
            return self.names.expressions | leaves
        nodes = self.names.tree.nodes
        subjects = {node.subject for node in nodes if node.kind is Kind.CONDITION} - leaves.keys()
        subjects.update(name for leaf in leaves.values() for name in leaf.conditions)
        pairs = ((name, comparison_of(name)) for name in sorted(subjects))
        readers = {name: entry_reader(name, each.entry) for name, each in pairs if each is not None}
        return self.names.expressions | leaves | readers

    def expression_of_job(self, name: str) -> Expression | None:
        """See `MissionEntries`: a comparison, with the job's id or one of its arguments."""
        comparison = comparison_of(name)
        if comparison is None or not self.is_condition(name):
            return None
        own = self.is_own(name)
        return any_of(name, self.robots) if own else entry_reader(name, comparison.entry)

    def read_by(self, guard: str) -> tuple[str, ...]:
        """See `MissionEntries`."""
        return (guard,) if self.is_own(guard) else super().read_by(guard)

    @cached_property
    def guards(self) -> Mapping[int, tuple[Guard, ...]]:  # type: ignore[override]
        """See `MissionEntries`. Nodes without such guards are left out. Of guards with actions only
        Sequences and Fallbacks are read with a robot's own values.
        """
        nodes, in_order = self.names.tree.nodes, (Kind.SEQUENCE, Kind.FALLBACK)
        with_actions = self.names.with_actions.items()
        asking = {name: each for name, each in with_actions if nodes[each.node].kind in in_order}
        read = {name: each.conditions for name, each in self.expressions.items()}
        read |= {name: each.conditions for name, each in asking.items()}
        own = {
            name
            for name, conditions in read.items()
            if self.is_own(name) or any(map(self.is_own, conditions))
        }
        if not own:
            return {}
        found = {}
        for node in self.names.tree.actions():
            guards = tuple(g for g in self.names.guards_of[node.index] if g[0] in own)
            if guards:
                found[node.index] = guards
        return found
