"""What features keep of a run for its summary, and tell of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.observer.newest import Newest


class FeatureHistory(ABC):
    """What a feature keeps of one run. `name`: what its rows are called in the summary."""

    name: ClassVar[str]
    rows: Newest[Any]

    @abstractmethod
    def fact(self, entry: Entry, now_us: int) -> str:
        """Take in a fact of one of the feature's kinds; returns a line for the timeline."""

    def begun(self, robot: str, claim: Claim) -> None:
        """A robot has begun what it claims."""

    @abstractmethod
    def to_json(self, seconds: Callable[[int], float | None]) -> list[dict[str, Any]]:
        """The rows as plain data; `seconds` makes a time of the summary of one in us."""
