"""Which operators' commands this robot's journal holds, and the queries that wait until it does."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.facts.records import OPERATORS
from mrbt_mesh.core.membership.replica import Durability

# Of more queries than that the oldest are forgotten: their clients ask again.
MAX_WAITING = 1_000


@dataclass(frozen=True, slots=True)
class AwaitedAnswer:
    """An answer that is given once this robot's journal holds the entry of this name, at once if it
    keeps none.

    `make` makes it then, so that it tells what the command has become by that time.
    """

    name: str
    make: Callable[[], dict[str, Any]]


class CommandsOnDisk:
    """The operators' commands of one robot's facts, as far as its journal is known to hold them."""

    def __init__(self, durability: Durability) -> None:
        self._durability = durability
        # By entry: the number by which to know when it is on disk.
        self._numbers: dict[str, int] = {}
        # By query; the oldest first.
        self._waiting: dict[int, AwaitedAnswer] = {}

    def note(self, name: str, number: int) -> None:
        """The newest command of this name is on disk once this number is."""
        self._numbers[name] = number

    def forget(self, dropped: Iterable[tuple[str, str]]) -> None:
        """These facts, by author and name, were dropped."""
        for author, name in dropped:
            if author == OPERATORS:
                self._numbers.pop(name, None)

    def wait(self, query: int, answer: AwaitedAnswer) -> None:
        """This query is to be answered once the command is on disk."""
        self._waiting[query] = answer
        if len(self._waiting) > MAX_WAITING:
            del self._waiting[next(iter(self._waiting))]

    def take_answers(self) -> list[tuple[int, dict[str, Any]]]:
        """The queries that are to be answered now, each once, and the answers."""
        found = [query for query, each in self._waiting.items() if self._holds(each.name)]
        return [(query, self._waiting.pop(query).make()) for query in found]

    def _holds(self, name: str) -> bool:
        durability = self._durability
        is_kept = durability.may_promise and durability.is_on_disk(self._numbers.get(name, 0))
        return is_kept or not durability.keeps_journal
