"""The conditions that a mission declares: the team's, and the robots' own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class ConditionType:
    """A declared condition; a ground condition that nobody has set reads as `default`."""

    name: str
    parameters: tuple[str, ...] = ()
    default: bool = False


def conditions_from_json(data: Mapping[str, Any]) -> dict[str, ConditionType]:
    """What a compiled mission says of them; raises TypeError or ValueError for anything else."""
    return {name: ConditionType(name, tuple(p), default) for name, (p, default) in data.items()}
