"""What a mission declares of values and of conditions of each robot."""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.core.mission.conditions import (
    MAX_DECIMALS,
    MAX_TEXT,
    MAX_UNITS,
    ConditionType,
    EntryTraits,
    Value,
)
from mrbt_mesh.core.mission.names import is_argument
from mrbt_mesh.features.values.blackboard import ValueType


@dataclass(frozen=True, slots=True)
class Traits(EntryTraits):
    """`per_robot`: every robot of the mission has its own, `per_job`: every job. `values`: what an
    entry holds that is neither true nor false; None: it is a condition.
    """

    per_robot: bool = False
    values: ValueType | None = None
    per_job: bool = False

    @property
    def is_truth(self) -> bool:
        """See `EntryTraits`."""
        return self.values is None

    def fits(self, default: Value | None) -> bool:
        """See `EntryTraits`."""
        values = self.values
        if values is None:
            return isinstance(default, bool) and not self.per_job
        numbers = (values.longest, values.low, values.high, values.decimals)
        return (
            all(-MAX_UNITS <= number <= MAX_UNITS for number in numbers)
            and 0 <= values.longest <= MAX_TEXT
            and 0 <= values.decimals <= MAX_DECIMALS
            and all(map(is_argument, values.choices))
            and values.low <= values.high
            and (default is None or values.fits(default))
        )


_USUAL = Traits()


def traits_of(known: ConditionType) -> Traits:
    """The traits of a declared condition or entry."""
    return known.traits if isinstance(known.traits, Traits) else _USUAL
