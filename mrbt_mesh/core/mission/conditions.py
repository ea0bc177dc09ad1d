"""Declared conditions, other entries that are declared alike, and what their names mean."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from mrbt_mesh.core.feature import features
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

    @abstractmethod
    def to_json(self) -> list[Any]:
        """Plain data: whether something is unusual of a condition, and what there is of others."""


@dataclass(frozen=True, slots=True)
class ConditionType:
    """A declared condition, or another entry by its `traits`; `default` is the value of a ground
    one that nobody has set, None if it has none.

    `failure`: it follows from failure reasons, and robots' programs do not set it.
    """

    name: str
    parameters: tuple[str, ...] = ()
    default: Value | None = False
    failure: FailureReason | None = None
    traits: EntryTraits | None = None

    @property
    def is_truth(self) -> bool:
        """Whether it is true or false."""
        return self.traits is None or self.traits.is_truth

    def to_json(self) -> list[Any]:
        """Its fields in their order; the last ones only where they differ from the usual."""
        first, *more = self.traits.to_json() if self.traits is not None else [False]
        failure = self.failure.to_json() if self.failure is not None else None
        rest = [first, failure, *more]
        while rest and not more and not rest[-1]:
            rest.pop()
        return [list(self.parameters), self.default, *rest]

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
    parameters, *given = row
    usual: list[Any] = [False, False, None]
    default, first, failure, *more = given + usual[len(given) :]
    reason = None if failure is None else FailureReason.from_json(failure)
    traits = None
    if first is not False or more:
        found = (feature.condition_traits([first, *more]) for feature in features())
        traits = next((each for each in found if each is not None), None)
        if traits is None:
            raise ValueError(f"condition {name}: unknown traits")
    return ConditionType(name, tuple(parameters), default, reason, traits)


def truth_of(value: Any) -> bool | None:
    """A truth value of a robot's program, Python's or numpy's bool; None: it is none."""
    if isinstance(value, bool):
        return value
    kind = type(value)
    is_numpy = kind.__module__ == "numpy" and kind.__name__ in ("bool", "bool_")
    return bool(value) if is_numpy else None
