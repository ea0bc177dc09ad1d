"""Which requests are kept, brought up to date after each event: what has changed is found out and
handed to the seating.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import compress
from itertools import count as numbers
from operator import is_not
from typing import TypeAlias

from mrbt_mesh.core.incremental.consistency.bitsets import RobotBitset
from mrbt_mesh.core.incremental.consistency.matching import Matching
from mrbt_mesh.core.incremental.consistency.slots import Pool, Row, SlotGroup
from mrbt_mesh.core.planning.demands import Demand

Groups: TypeAlias = Sequence[Sequence[Demand]]
_GAP = 1 << 40  # between the labels of neighbours, so that others can come in between


class SharedPinError(Exception):
    """A robot is pinned to two requests."""


class KeptRequests:
    """What is kept with certain pins, without preemption; brought up to date at every change.

    `pins`: robot -> row that it is pinned to, also where the pin does not hold.
    """

    def __init__(self, bits: RobotBitset) -> None:
        self.rows: list[Row] = []
        self.pins: dict[str, Row] = {}
        self.matching = Matching()
        self._bits = bits
        self._joined = 0
        self._robots = 0
        self._held = 0
        self._futile: frozenset[str] = frozenset()
        self._excluded: dict[Row, None] = {}
        self._groups: list[Sequence[Demand]] = []
        self._kept: tuple[int, list[Row], list[int]] = (-1, [], [])

    @property
    def kept(self) -> list[int]:
        """The indices of the requests that are kept."""
        flips, rows, kept = self._kept
        if flips != self.matching.flips or rows is not self.rows:
            kept = [row.index for row in self.rows if row.kept]
            self._kept = (self.matching.flips, self.rows, kept)
        return kept

    def would_matter(self, robots: Collection[str]) -> bool:
        """Whether some request might be kept if the pins of these robots, all futile, were none."""
        return self.matching.may_help(self._bits.of(robots))

    def update(self, groups: Groups, excluded: Collection[int], futile: frozenset[str]) -> None:
        """Other requests or robots. Pins of `futile` robots do not hold.

        Raises SharedPinError, after which this object is of no use any more.
        """
        found = None if _is_quicker_anew(0, len(groups)) else self._matched(groups)
        if found is None:
            self._build(groups, excluded, futile)
            return
        gone, changed, rows = found
        fresh = [] if rows is self.rows else [row for row in rows if row.label < 0]
        count = len(gone) + len(fresh)
        if _is_quicker_anew(count, len(rows)) or not _labelled(rows, fresh):
            self._build(groups, excluded, futile)
            return
        now_excluded = {rows[index]: None for index in excluded}
        turned = [row for row in self._excluded if row not in now_excluded and row not in gone]
        turned += [row for row in now_excluded if row not in self._excluded and row not in fresh]
        self._excluded = now_excluded
        newcomers = self._newcomers()
        self._repin(gone, changed, fresh, turned, futile)
        again = dict.fromkeys([row for row, _ in changed] + turned)
        if futile != self._futile:
            other = [robot for robot in sorted(futile ^ self._futile) if robot in self.pins]
            again |= dict.fromkeys(self.pins[robot] for robot in other)
            self._futile = futile
        for robot in newcomers:
            again |= {row: None for row in rows for d in row.source if robot in d.candidates}
        changes = self._changes(again)
        if changes is None:
            self._build(groups, excluded, futile)
            return
        grown = self._grown(changes, newcomers)
        changes = [change for change in changes if change[0].pool not in grown]
        count += (self._robots & ~self._held ^ self.matching.free).bit_count()
        if _is_quicker_anew(count + len(changes) + len(grown), len(rows)):
            self._build(groups, excluded, futile)
            return
        for row in gone:
            self.matching.remove_row(row)
        self._move_robots(newcomers, grown, changes)
        self._decide(fresh, turned, changes)
        self.rows = rows
        self._groups = list(groups)

    def _build(self, groups: Groups, excluded: Collection[int], futile: frozenset[str]) -> None:
        """From scratch."""
        bits = self._bits
        self._groups = list(groups)
        self.rows = [Row(index * _GAP, group) for index, group in enumerate(groups)]
        self.pins.clear()
        self._held, self._futile, self._robots = 0, futile, bits.all
        self._joined = len(bits.joined)
        self._excluded = {self.rows[index]: None for index in excluded}
        for row in self.rows:
            if row not in self._excluded:
                self._pin(row)
        self.matching = seating = Matching(bits.all & ~self._held)
        for index, row in enumerate(self.rows):
            row.index = index
            seating.add_row(row, self._asks(row))
            if row in self._excluded:
                row.wanted = False
            else:
                seating.decide(row)

    def _asks(self, row: Row) -> list[tuple[int, int]]:
        """(robots, seats needed) for each demand of a row."""
        mask, futile = self._bits.mask, self._futile
        asks = []
        for demand in row.source:
            need = demand.lower
            if need and demand.pinned:
                need = max(0, need - sum(robot not in futile for robot in demand.pinned))
            asks.append((mask(demand.candidates), need))
        return asks

    def _matched(
        self, groups: Groups
    ) -> tuple[list[Row], list[tuple[Row, Sequence[Demand]]], list[Row]] | None:
        """(rows that are gone, rows with other demands, all rows, new ones with label -1)."""
        old, rows = self._groups, self.rows
        shared = min(len(old), len(groups))
        start = next(compress(numbers(), map(is_not, old, groups)), shared)
        if start == len(old) == len(groups):
            return [], [], rows
        end = next(compress(numbers(), map(is_not, reversed(old), reversed(groups))), shared)
        end = min(end, shared - start)
        olds, news = rows[start : len(old) - end], groups[start : len(groups) - end]
        if len(olds) == len(news):
            both = zip(olds, news, strict=True)
            pairs = [(row, group) for row, group in both if row.source is not group]
            if all(_name(row.source) == _name(group) for row, group in pairs):
                return [], pairs, rows
        known = {_name(row.source): row for row in olds}
        if len(known) < len(olds):
            return None
        pairs, found, last = [], [], -1
        for group in news:
            row = known.get(_name(group))
            if row is None or row.label <= last:
                found.append(Row(-1, group))
                continue
            del known[_name(group)]
            last = row.label
            found.append(row)
            if row.source is not group:
                pairs.append((row, group))
        rows = [*rows[:start], *found, *rows[len(old) - end :]]
        for index in range(start, len(rows)):
            rows[index].index = index
        return list(known.values()), pairs, rows

    def _newcomers(self) -> dict[str, int]:
        joined = self._bits.joined[self._joined :]
        self._joined = len(self._bits.joined)
        return {robot: bit for robot, bit in joined if self._bits.bit(robot) == bit}

    # -- pins ---------------------------------------------------------------------------------

    def _repin(
        self,
        gone: Sequence[Row],
        changed: Sequence[tuple[Row, Sequence[Demand]]],
        fresh: Sequence[Row],
        turned: Sequence[Row],
        futile: frozenset[str],
    ) -> None:
        """Bring `pins` up to date, and the demands of rows that have others."""
        for row in [*gone, *turned, *(row for row, _ in changed)]:
            for demand in row.source:
                for robot in demand.pinned:
                    if self.pins.get(robot) is row:
                        del self.pins[robot]
                        self._held &= ~self._bits.bit(robot)
        for row, group in changed:
            row.source = group
        for row in dict.fromkeys([*turned, *(row for row, _ in changed), *fresh]):
            if row not in self._excluded:
                self._pin(row)
        if futile != self._futile or self._bits.all != self._robots:
            self._robots = self._bits.all
            self._held = self._bits.of([robot for robot in self.pins if robot not in futile])

    def _pin(self, row: Row) -> None:
        for demand in row.source:
            for robot in demand.pinned:
                if robot in self.pins:
                    raise SharedPinError
                self.pins[robot] = row
                if robot not in self._futile:
                    self._held |= self._bits.bit(robot)

    # -- carrying it out ----------------------------------------------------------------------

    def _changes(self, rows: Iterable[Row]) -> list[tuple[SlotGroup, int, int]] | None:
        """(ask, robots, seats needed) where it is no longer so; None: other demands altogether."""
        robots, changes = self._robots, []
        for row in rows:
            wanted = self._asks(row)
            if len(wanted) != len(row.asks):
                return None
            for ask, (mask, need) in zip(row.asks, wanted, strict=True):
                if (ask.pool.robots ^ mask) & robots:
                    changes.append((ask, mask, need))
                elif ask.need != need:
                    changes.append((ask, ask.pool.robots, need))
        return changes

    def _grown(
        self, changes: Sequence[tuple[SlotGroup, int, int]], newcomers: Mapping[str, int]
    ) -> dict[Pool, int]:
        """Pools that all demands on them stay with, though a newcomer can meet these as well."""
        asks: dict[tuple[Pool, int], int] = {}
        for ask, mask, need in changes if newcomers else ():
            added = mask & ~ask.pool.robots
            if (ask.pool.robots | added) & self._robots == mask & self._robots and ask.need == need:
                asks[ask.pool, added] = asks.get((ask.pool, added), 0) + 1
        return {
            pool: added
            for (pool, added), count in asks.items()
            if added in newcomers.values() and self.matching.can_grow(pool, added, count)
        }

    def _move_robots(
        self,
        newcomers: Mapping[str, int],
        grown: Mapping[Pool, int],
        changes: Sequence[tuple[SlotGroup, int, int]],
    ) -> None:
        seating = self.matching
        free = self._robots & ~self._held
        for robot in _each(seating.free & ~free):
            seating.remove_robot(robot)
        for robot in _each(free & ~seating.free):
            seating.add_robot(robot)
        for robot in newcomers.values():
            wider = [mask for _, mask, _ in changes if mask & robot]
            wider += [pool.robots | robot for pool, added in grown.items() if added == robot]
            seating.widen(robot, wider)
        for pool, robot in grown.items():
            seating.grow(pool, robot)

    def _decide(
        self,
        fresh: Sequence[Row],
        turned: Sequence[Row],
        changes: Sequence[tuple[SlotGroup, int, int]],
    ) -> None:
        seating = self.matching
        for row in turned:
            if row in self._excluded:
                seating.withdraw(row)
            else:
                seating.due(row)
        for ask, mask, need in changes:
            if mask != ask.pool.robots:
                seating.set_robots(ask, mask)
            if need != ask.need:
                seating.set_need(ask, need)
        for row in fresh:
            seating.add_row(row, self._asks(row))
            if row in self._excluded:
                row.wanted = False
            else:
                seating.due(row)
        seating.settle()


def _is_quicker_anew(changes: int, requests: int) -> bool:
    """Whether so many changes are better met by deciding all requests from scratch."""
    return requests < 12 or changes > requests // 8


def _each(robots: int) -> Iterable[int]:
    while robots:
        robot = robots & -robots
        robots ^= robot
        yield robot


def _name(group: Sequence[Demand]) -> str:
    return group[0].request.activation if group else ""


def _labelled(rows: Sequence[Row], fresh: Sequence[Row]) -> bool:
    """Give new rows labels between those of their neighbours; False: there is no room."""
    for row in fresh:
        before = rows[row.index - 1].label if row.index else -_GAP
        after = next((r.label for r in rows[row.index + 1 :] if r.label >= 0), before + 2 * _GAP)
        row.label = (before + after) // 2
        if row.label <= max(before, -1):
            return False
    return True
