"""The team's blackboard: entries with a declared type, and comparisons with their values.

A condition is an entry that holds true or false. Any other entry holds a text, or a whole number of
units (12.5 % in tenths: 125), so that no decision depends on floats. The tree reads such an entry
with a *comparison*, `battery@A1 < 30`, which it treats as a condition; a call of a task reads it as
an argument, `fetch($found)`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from typing import Any, NamedTuple

from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.names import is_argument

EQUALITY: Mapping[str, Callable[[Any, Any], bool]] = {"==": operator.eq, "!=": operator.ne}
OPERATORS: Mapping[str, Callable[[Any, Any], bool]] = {
    **EQUALITY,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}


@dataclass(frozen=True, slots=True)
class ValueType:
    """What an entry may hold: one of `choices`; a text of at most `longest` characters; or a number
    from `low` to `high`, in units of 10 to the power of -`decimals`.
    """

    choices: tuple[str, ...] = ()
    longest: int = 0
    low: int = 0
    high: int = 0
    decimals: int = 0

    @property
    def is_number(self) -> bool:
        """Whether values have an order."""
        return not self.choices and not self.longest

    def __str__(self) -> str:
        """For people, after "it is": `one of red, blue`, `a number from 0.0 to 100.0`."""
        if self.choices:
            listed = ", ".join(self.choices[:20]) + (", ..." if len(self.choices) > 20 else "")
            return f"one of {listed}"
        if self.longest:
            return f"a text of 1 to {self.longest} letters, digits, _, ., + or -"
        kind = f"number with {self.decimals} decimals" if self.decimals else "whole number"
        return f"a {kind} from {self.text(self.low)} to {self.text(self.high)}"

    def value(self, given: Any, is_rounded: bool = False) -> int | str:
        """A value as facts have it. Raises ValueError for one that the type does not have.

        `given`: text or a number, as in files and programs. `is_rounded`: a number with more
        decimals than the type has is rounded, as those of sensors are.
        """
        if isinstance(given, bool):
            given = str(given).lower()
        if self.is_number:
            found: int | str | None = self._units(given, is_rounded)
        else:
            found = str(given)
        if found is None or not self.fits(found):
            raise ValueError(f"it is {self}, not {given!r:.80}")
        return found

    def _units(self, given: Any, is_rounded: bool) -> int | None:
        try:
            units = Decimal(str(given)).scaleb(self.decimals)
            whole = int(units.to_integral_value())
        except (InvalidOperation, ValueError, OverflowError):
            return None
        return whole if units == whole or (is_rounded and self.decimals) else None

    def fits(self, value: Any) -> bool:
        """Whether facts may have this value."""
        if self.is_number:
            return type(value) is int and self.low <= value <= self.high
        if not isinstance(value, str):
            return False
        if self.choices:
            return value in self.choices
        return len(value) <= self.longest and is_argument(value)

    def samples(self) -> tuple[str, ...]:
        """Arguments to check for all values: all choices, a text, the ends of a range."""
        ends = self.text(self.low), self.text(self.high)
        return self.choices or (("text"[: self.longest],) if self.longest else ends)

    def text(self, value: Value) -> str:
        """A value of this type as an argument."""
        if not self.decimals or not isinstance(value, int):
            return str(value)
        whole, part = divmod(abs(value), 10**self.decimals)
        return f"{'-' if value < 0 else ''}{whole}.{part:0{self.decimals}}"

    def holds(self, comparison: EntryComparison, value: Value | None) -> bool:
        """Whether a comparison holds for a value of this type; none does for an entry not set, nor
        with a job's parameter that has no value yet.
        """
        if value is None or "{" in comparison.literal:
            return False
        return OPERATORS[comparison.operator](value, self.value(comparison.literal))


class EntryComparison(NamedTuple):
    """A comparison of an entry, by its ground name, with a value of its type."""

    entry: str
    operator: str
    literal: str

    def __str__(self) -> str:
        return " ".join(self)


@lru_cache(maxsize=4_096)
def comparison_of(condition: str) -> EntryComparison | None:
    """The comparison that a leaf names, `found == red`; None: it names a condition."""
    if " " not in condition:
        return None
    parts = condition.split(" ")
    return EntryComparison(*parts) if len(parts) == 3 and parts[1] in OPERATORS else None
