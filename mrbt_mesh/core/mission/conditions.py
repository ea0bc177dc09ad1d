"""Declared conditions, other entries that are declared alike, and what their names mean."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from mrbt_mesh.core.codec import KEY
from mrbt_mesh.core.mission.failure_reasons import FailureReason

# Of a condition or another entry; None: it is not set.
Value: TypeAlias = bool | int | str
# The longest text, the largest number, and the most decimals.
MAX_TEXT = 64
MAX_UNITS = 10**15
MAX_DECIMALS = 6


class EntryTraits(ABC):
    """What a feature has a mission declare of a condition or another entry."""

    @property
    @abstractmethod
    def is_truth(self) -> bool:
        """Whether it is a condition: true or false."""

    @abstractmethod
    def fits(self, default: Value | None) -> bool:
        """Whether the traits are not damaged, and an entry with them may have this default."""


@dataclass(frozen=True, slots=True)
class ConditionType:
    """A declared condition, or another entry by its `traits`; `default` is the value of a ground
    one that nobody has set, None if it has none.

    `failure`: it follows from failure reasons, and robots' programs do not set it.
    """

    name: str = field(metadata=KEY)
    parameters: tuple[str, ...] = ()
    default: Value | None = False
    failure: FailureReason | None = None
    traits: EntryTraits | None = None

    @property
    def is_truth(self) -> bool:
        """Whether it is true or false."""
        return self.traits is None or self.traits.is_truth

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


def truth_of(value: Any) -> bool | None:
    """A truth value of a robot's program, Python's or numpy's bool; None: it is none."""
    if isinstance(value, bool):
        return value
    kind = type(value)
    is_numpy = kind.__module__ == "numpy" and kind.__name__ in ("bool", "bool_")
    return bool(value) if is_numpy else None
