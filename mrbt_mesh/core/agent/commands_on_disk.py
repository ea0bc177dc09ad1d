"""Which operators' commands this robot's journal holds, and the queries that wait for that."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.facts.records import OPERATORS
from mrbt_mesh.core.membership.replica import Durability

# Beyond this many waiting queries the oldest are dropped: their clients ask again.
MAX_WAITING = 1_000


@dataclass(frozen=True, slots=True)
class AwaitedAnswer:
    """An answer that waits until this robot's journal holds the entry `name`; it is given at once
    if the robot keeps no journal.

    `make` is called only then, so that the answer tells what has become of the command by that
    time.
    """

    name: str
    make: Callable[[], dict[str, Any]]


class CommandsOnDisk:
    """The operators' commands among one robot's facts, and whether its journal holds them."""

    def __init__(self, durability: Durability) -> None:
        self._durability = durability
        # Name of the entry -> the journal's number for it.
        self._numbers: dict[str, int] = {}
        # Query -> its answer, the oldest first.
        self._waiting: dict[int, AwaitedAnswer] = {}

    def note(self, name: str, number: int) -> None:
        """Note that the newest command of this name is on disk once this number is."""
        self._numbers[name] = number

    def forget(self, dropped: Iterable[tuple[str, str]]) -> None:
        """Forget these dropped facts, given by author and name."""
        for author, name in dropped:
            if author == OPERATORS:
                self._numbers.pop(name, None)

    def wait(self, query: int, answer: AwaitedAnswer) -> None:
        """Have this query answered once the command is on disk."""
        self._waiting[query] = answer
        if len(self._waiting) > MAX_WAITING:
            del self._waiting[next(iter(self._waiting))]

    def take_answers(self) -> list[tuple[int, dict[str, Any]]]:
        """Return the queries that can be answered now, with their answers, and remove them."""
        found = [query for query, each in self._waiting.items() if self._holds(each.name)]
        return [(query, self._waiting.pop(query).make()) for query in found]

    def _holds(self, name: str) -> bool:
        durability = self._durability
        is_kept = durability.may_promise and durability.is_on_disk(self._numbers.get(name, 0))
        return is_kept or not durability.keeps_journal
