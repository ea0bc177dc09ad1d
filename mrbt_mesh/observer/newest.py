"""The newest entries of a list that grows as long as a run lasts."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import TypeVar, overload

# Of each list, in a run that is watched live. Its recording has all of them.
LIVE_ENTRIES = 1_000

_Entry = TypeVar("_Entry")


class Newest(Sequence[_Entry]):
    """A sequence of the entries that are kept. Each has a number, from 0, which stays the same.

    Beyond `limit` the oldest eighth of those that `is_over` are dropped; None: all are kept.
    `total`: how many entries there were. `first`: below this number only those are kept that were
    not over when entries were last dropped.
    """

    def __init__(
        self, limit: int | None = None, is_over: Callable[[_Entry], bool] = lambda _: True
    ) -> None:
        self.total = self.first = 0
        self._limit, self._is_over = limit, is_over
        self._entries: list[_Entry] = []
        self._numbers: list[int] = []

    @overload
    def __getitem__(self, index: int) -> _Entry: ...
    @overload
    def __getitem__(self, index: slice) -> list[_Entry]: ...

    def __getitem__(self, index: int | slice) -> _Entry | list[_Entry]:
        return self._entries[index]

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def dropped(self) -> int:
        """How many entries there were that are not kept."""
        return self.total - len(self)

    @property
    def kept_before_first(self) -> list[int]:
        """The numbers below `first` whose entries are kept."""
        return self._numbers[: bisect_left(self._numbers, self.first)]

    def append(self, entry: _Entry) -> list[_Entry]:
        """Add an entry; returns those that are dropped for it."""
        self._entries.append(entry)
        self._numbers.append(self.total)
        self.total += 1
        if self._limit is None or len(self) <= self._limit:
            return []
        over = (i for i, each in enumerate(self._entries) if self._is_over(each))
        gone = {i for i, _ in zip(over, range(self._limit // 8 + 1), strict=False)}
        dropped = [each for i, each in enumerate(self._entries) if i in gone]
        if gone:
            self.first = self._numbers[max(gone)] + 1
        self._entries = [each for i, each in enumerate(self._entries) if i not in gone]
        self._numbers = [each for i, each in enumerate(self._numbers) if i not in gone]
        return dropped

    def since(self, number: int) -> list[tuple[int, _Entry]]:
        """The entries that are kept from this number on, with their numbers."""
        begin = bisect_left(self._numbers, number)
        return list(zip(self._numbers[begin:], self._entries[begin:], strict=True))

    def get(self, number: int) -> _Entry | None:
        """The entry of this number; None: it is not kept."""
        index = bisect_left(self._numbers, number)
        is_kept = index < len(self) and self._numbers[index] == number
        return self._entries[index] if is_kept else None
