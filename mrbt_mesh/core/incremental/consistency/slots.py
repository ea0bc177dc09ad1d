"""What a seating is made of: pools of robots, what requests ask of them, and witnesses."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Any


class Pool:
    """The robots that some demands can have, and those that sit for them.

    `asks` are the asks with seats here, by label. Any of the seats may be any ask's.
    """

    __slots__ = ("asks", "robots", "seats", "users")

    def __init__(self, robots: int) -> None:
        self.robots = robots
        self.seats = 0
        self.asks: list[SlotGroup] = []
        self.users = 0


class SlotGroup:
    """One demand of a row: `need` seats in a pool, of which it has got `got`."""

    __slots__ = ("got", "need", "pool", "row")

    def __init__(self, row: Row, pool: Pool, need: int) -> None:
        self.row = row
        self.pool = pool
        self.need = need
        self.got = 0


class Row:
    """One request. `source` and `index` are the caller's; a row not `wanted` is not decided."""

    __slots__ = ("asks", "index", "kept", "label", "source", "wanted", "witness")

    def __init__(self, label: int, source: Any) -> None:
        self.label = label
        self.source = source
        self.index = 0
        self.asks: list[SlotGroup] = []
        self.kept = False
        self.wanted = True
        self.witness: HallWitness | None = None

    @property
    def lacks(self) -> bool:
        """Whether it has fewer seats than it needs."""
        return any(ask.got < ask.need for ask in self.asks)


class HallWitness:
    """Robots that show for some rows, sorted by label, that they cannot be kept.

    `needs`: how many of these robots the row asks for. `lacks`: by how many that is too much,
    given the rows kept before it; at least 1, or the row has to be looked at again.
    """

    __slots__ = ("labels", "lacks", "needs", "robots")

    def __init__(self, robots: int) -> None:
        self.robots = robots
        self.labels: list[int] = []
        self.needs: list[int] = []
        self.lacks: list[int] = []

    def spare(self, label: int) -> int | None:
        """At most so many of the robots are left at this label; None: no row before shows it."""
        if self.labels[-1] <= label:
            return self.needs[-1] - self.lacks[-1]
        index = bisect_right(self.labels, label) - 1
        return self.needs[index] - self.lacks[index] if index >= 0 else None

    def needed(self, row: Row) -> int:
        """How many of these robots a row asks for."""
        robots, count = self.robots, 0
        for ask in row.asks:
            able = ask.pool.robots
            if able & robots == able:
                count += ask.need
        return count

    def add(self, label: int, need: int, lack: int) -> None:
        index = bisect_left(self.labels, label)
        self.labels.insert(index, label)
        self.needs.insert(index, need)
        self.lacks.insert(index, lack)

    def remove(self, label: int) -> None:
        index = bisect_left(self.labels, label)
        del self.labels[index], self.needs[index], self.lacks[index]

    def change(self, start: int, more: int) -> None:
        """The rows from index `start` on lack so many more."""
        self.lacks[start:] = [lack + more for lack in self.lacks[start:]]

    def first_broken(self, start: int) -> int | None:
        """The label of the first row from index `start` on that is no longer shown to lack any."""
        rest = self.lacks[start:]
        if not rest or min(rest) > 0:
            return None
        return self.labels[start + next(i for i, lack in enumerate(rest) if lack <= 0)]


def by_label(ask: SlotGroup) -> int:
    return ask.row.label
