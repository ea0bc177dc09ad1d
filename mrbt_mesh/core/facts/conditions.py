"""How the team reads a condition, and how often a guard has changed its value.

Every robot may set a condition. Over all authors the value with the greatest (changes, stamp,
author) counts. A condition that nobody has set has its declared default. If every robot has its own
condition, the name without a robot holds if it holds for any robot of the mission.

A boolean alternates, so its changes show how often it has changed to either value. This is not so
for an *expression*, several conditions that decide together: a robot that sees its value change
writes that down, with how often each of its conditions had changed by then. Over all authors the
greatest number of changes counts; of equal ones, the greatest of each that was read. Only a robot
that knows everything that was read before may write the next one, so late news is not mistaken for
a change.

Other blackboard entries do not alternate, and two robots may give one of them different values with
the same changes. So each comparison with such an entry is an expression, and what was read of the
entry is noted as (changes, stamp, author), which identifies one value.

A note about an expression counts once everything read for it is known here.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping, Sequence

from mrbt_mesh.core.bt.evaluation import EvaluationFacts, OtherConditions
from mrbt_mesh.core.bt.guards import Expression, Guard, GuardWithActions
from mrbt_mesh.core.facts.records import ConditionValue, ExpressionChanges, Reading
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import split_owner

_NOT_SET = ConditionValue(None, 0, 0), ""


class Conditions:
    """The conditions of one mission, and its guard expressions, as the facts have them."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._has_values = mission.entries.has_values
        self._by_author: dict[str, dict[str, ConditionValue]] = {}
        self._standing: dict[str, tuple[ConditionValue, str]] = {}
        # Cached, as they are read at every tick: standing values, and defaults that were needed.
        self._values: dict[str, bool] = {}
        self._defaults: dict[str, bool] = {}
        self._noted: dict[str, dict[str, ExpressionChanges]] = {}
        # Notes that rest on something that is not known here yet.
        self._early: dict[str, dict[str, ExpressionChanges]] = {}
        self._readers: dict[str, list[Expression]] = {}
        # Expressions that may have changed since `unnoted` last looked at them.
        self._touched: dict[str, Expression] = {}
        self._expressions: Mapping[str, Expression] = {}
        self._with_actions: Mapping[str, GuardWithActions] = {}
        self.use(mission)
        # Values and counts before the changes since guards with actions were last checked.
        self._values_before: dict[str, bool] = {}
        self._counts_before: dict[Guard, int] = {}

    def use(self, mission: Mission) -> None:
        """Read the guards of this mission's tree from now on, as the jobs in it have changed."""
        before, self._mission = self._expressions, mission
        actions_before = self._with_actions
        self._expressions = mission.entries.expressions
        self._with_actions = mission.evaluator.with_actions
        self._readers.clear()
        for expression in self._expressions.values():
            for name in expression.conditions:
                self._readers.setdefault(name, []).append(expression)
        new = {name: e for name, e in self._expressions.items() if name not in before}
        if before or mission.jobs:
            self._touched = {n: e for n, e in self._touched.items() if n in self._expressions} | new
        for name in before.keys() - self._expressions.keys():
            self._defaults.pop(name, None)
            self._values.pop(name, None)
        guards = {*self._expressions, *self._with_actions} - before.keys() - actions_before.keys()
        for name in sorted(guards & self._noted.keys()):
            for author, noted in self._noted.pop(name).items():
                self.note(name, author, noted)

    def set(self, name: str, author: str, value: ConditionValue) -> None:
        """Set the author's value. Only values of ended jobs are ever dropped."""
        self._remember(name)
        self._by_author.setdefault(name, {})[author] = value
        self._stand(name)
        if self._early:
            self._note_early()

    def counts(self, name: str) -> dict[str, int]:
        """How often each author says that a condition has changed."""
        return {by: each.changes for by, each in self._by_author.get(name, {}).items()}

    def drop(self, name: str, author: str) -> None:
        """Drop the author's value of an entry, together with the entry's job."""
        self._remember(name)
        del self._by_author[name][author]
        self._stand(name)

    def _stand(self, name: str) -> None:
        """Find the value that counts, and invalidate what depends on it."""
        values = self._by_author[name]
        if values:
            _, _, winner = max((each.changes, each.stamp, by) for by, each in values.items())
            self._standing[name] = values[winner], winner
        else:
            del self._by_author[name], self._standing[name]
        for each in self._affected(name):
            self._values.pop(each, None)
        self._touch_readers(name)

    def value(self, name: str) -> bool:
        """True if the condition or comparison holds."""
        value = self._values.get(name)
        if value is None:
            value = self._read(name, {})
            if not self._has_values or name in self._expressions or " " not in name:
                self._values[name] = value
        return value

    def entry(self, name: str) -> Value | None:
        """The value of a condition or another blackboard entry; None if it is not set."""
        if not self._has_values:
            return self.value(name)
        standing = self._standing.get(name)
        return self._mission.entries.default_of(name) if standing is None else standing[0].value

    def of_robot(self, robot: str, name: str) -> bool:
        """True if the condition holds for a robot: its own one if every robot has its own."""
        return self.value(self._mission.entries.of(robot, name))

    def after(self, changes: Mapping[str, Value | None]) -> dict[str, bool]:
        """The values that conditions and comparisons would have after these changes of entries."""
        affected = {each for name in changes for each in self._affected(name)}
        return {name: self._read(name, changes) for name in sorted(affected)}

    def _read(self, name: str, changes: Mapping[str, Value | None]) -> bool:
        """True if a condition holds after these changes."""
        entries = self._mission.entries
        if not entries.is_plain:
            found = entries.derived(
                name,
                lambda each: self._read(each, changes),
                lambda each: changes[each] if each in changes else self.entry(each),
            )
            if found is not None:
                return found
        if name in changes:
            return bool(changes[name])
        standing = self._standing.get(name)
        return self._default(name) if standing is None else bool(standing[0].value)

    def _affected(self, name: str) -> Iterator[str]:
        """The conditions that depend on a condition or entry, including a condition itself."""
        if not self._mission.entries.is_value(name):
            yield name
            if "@" in name:
                yield split_owner(name)[0]
        for reader in self._readers.get(name, ()):
            if not reader.id.startswith("#"):
                yield from self._affected(reader.id)

    def changes(self, name: str) -> int:
        """How often the condition or expression has changed."""
        if name in self._noted:
            return self.noted(name).changes
        standing = self._standing.get(name)
        return standing[0].changes if standing is not None else 0

    def seen(self, name: str) -> Reading:
        """What to note of a condition or entry when it is read."""
        if not self._mission.entries.is_value(name):
            return self.changes(name)
        value, author = self._standing.get(name, _NOT_SET)
        return value.changes, value.stamp, author

    def turns(self, name: str, value: bool) -> int:
        """How often the condition or expression has changed to `value`."""
        changes = self.changes(name)
        return self.turns_at(name, value, changes) if changes else 0

    def turns_at(self, name: str, value: bool, changes: int) -> int:
        """The same as `turns`, after any number of changes: a boolean alternates from its default.

        For a guard with actions, only changes against what it guards are counted, as True.
        """
        if name in self._with_actions:
            return changes if value else 0
        return changes // 2 if value == self._default(name) else (changes + 1) // 2

    def entries(self) -> dict[str, str]:
        """The blackboard entries that are set, without conditions, and their values as texts."""
        found = {}
        for name in sorted(filter(self._mission.entries.is_value, self._standing)):
            value = self.entry(name)
            if value is not None:
                found[name] = self._mission.entries.text(name, value)
        return found

    def names(self) -> list[str]:
        """The conditions that some robot has set, and the expressions that have changed."""
        return [*self._standing, *self._noted]

    def _default(self, name: str) -> bool:
        default = self._defaults.get(name)
        if default is None:
            expression = self._expressions.get(name)
            if expression is None or " " in name:
                default = self._mission.entries.default(name)
            else:
                at_first = (0,) * len(expression.conditions)
                default = expression_value(self._mission, expression, at_first)
            self._defaults[name] = default
        return default

    # -- expressions --------------------------------------------------------------------------

    def note(self, name: str, author: str, noted: ExpressionChanges) -> None:
        """Add an author's note about an expression, or about a guard with actions."""
        self._early.get(name, {}).pop(author, None)
        if self._is_early(name, noted):
            self._early.setdefault(name, {})[author] = noted
            return
        self._remember(name)
        self._noted.setdefault(name, {})[author] = noted
        if name in self._expressions:
            self._touched[name] = self._expressions[name]
            self._touch_readers(name)
        if self._early:
            self._note_early()

    def _is_early(self, name: str, noted: ExpressionChanges) -> bool:
        """True if something that was read is newer than what is known here."""
        if name in self._expressions:
            known = map(self.seen, self._expressions[name].conditions)
            return any(map(operator.gt, noted.read, known))
        guard = self._with_actions.get(name)
        return guard is not None and any(
            map(operator.gt, noted.read, map(self.changes, guard.conditions))
        )

    def _note_early(self) -> None:
        """Add the early notes again, as something became known; some may no longer be early."""
        early, self._early = self._early, {}
        for name, by_author in sorted(early.items()):
            for author, noted in sorted(by_author.items()):
                self.note(name, author, noted)

    def forget(self, name: str, author: str) -> None:
        """Drop an author's note about a guard, with the job in whose tree the guard was."""
        for known in (self._noted, self._early):
            noted = known.get(name, {})
            noted.pop(author, None)
            if not noted:
                known.pop(name, None)

    def _touch_readers(self, name: str) -> None:
        for expression in self._readers.get(name, ()):
            self._touched[expression.id] = expression

    def noted(self, name: str) -> ExpressionChanges:
        """What the team knows of an expression: the join of all authors' notes."""
        said = self._noted.get(name)
        if not said:
            return ExpressionChanges(0, ())
        changes = max(each.changes for each in said.values())
        rows = [each.read for each in said.values() if each.changes == changes]
        read: tuple[Reading, ...] = tuple(map(max, zip(*rows, strict=True)))
        return ExpressionChanges(changes, read)

    def unnoted(self) -> list[tuple[str, ExpressionChanges]]:
        """The expressions whose value has changed, by what is known here, with notes to write."""
        found = []
        for name, expression in sorted(self._touched.items()):
            noted = self.noted(name)
            read = tuple(map(self.seen, expression.conditions))
            if any(map(operator.lt, read, noted.read)):
                continue  # late news: checked again once the rest has arrived
            was = self._default(name) ^ bool(noted.changes % 2)
            if self._value_at(expression, read) != was:
                found.append((name, ExpressionChanges(noted.changes + 1, read)))
            else:
                del self._touched[name]
        return found

    def _value_at(self, expression: Expression, read: Sequence[Reading]) -> bool:
        """True if an expression holds, given what is known of its conditions now."""
        if self._has_values and any(map(self._mission.entries.is_value, expression.conditions)):
            return self.value(expression.id)
        return expression_value(self._mission, expression, read)

    # -- guards with actions ------------------------------------------------------------------

    def _remember(self, name: str) -> None:
        """Remember the values and counts of a condition or guard before a fact about it changes."""
        if not self._with_actions:
            return
        for each in self._affected(name):
            for value in (True, False):
                self._counts_before.setdefault((each, value), self.turns(each, value))
            if not each.startswith("#"):
                self._values_before.setdefault(each, self.value(each))

    def turned_with_actions(self, facts: EvaluationFacts) -> list[tuple[str, ExpressionChanges]]:
        """A guard with actions that lost its status through changed conditions, with the note to
        write.

        Returns one at a time, since what was done behind it must be done again before other guards
        are checked. A guard that has lost its status does not let through what it guards, so noting
        too much repeats nothing that is running.
        """
        before = OtherConditions(facts, self._values_before, self._counts_before)
        for guard in self._with_actions.values() if self._values_before else ():
            if self._values_before.keys().isdisjoint(guard.conditions):
                continue
            noted = self.noted(guard.id)
            read: tuple[Reading, ...] = tuple(map(self.changes, guard.conditions))
            if noted.read == read or any(map(operator.lt, read, noted.read)):
                continue  # other robots have seen it, or have seen more
            if self._mission.evaluator.has_turned(guard, before, facts):
                return [(guard.id, ExpressionChanges(noted.changes + 1, read))]
        self._values_before.clear()
        self._counts_before.clear()
        return []


def expression_value(mission: Mission, expression: Expression, readings: Sequence[Reading]) -> bool:
    """True if an expression holds (succeeds) when its conditions have changed so often."""
    holding = {
        name
        for name, changes in zip(expression.conditions, readings, strict=True)
        if isinstance(changes, int) and mission.entries.default(name) ^ bool(changes % 2)
    }
    return mission.evaluator.holds(expression, holding)
