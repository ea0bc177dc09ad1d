"""Seats for requests: a matching on bit masks that grows, shrinks and proves what does not fit.

Robots are bits of ints. Demands that the same robots can meet share a *pool*, so a search goes
from pool to pool, not from slot to slot. Requests are *rows*, kept in the order of their labels:
a row is kept exactly if all rows kept before it and its own demands can be met by different
robots. For a kept row the seats show it, for a rejected one a *witness* (Hall's theorem): a set of
robots among which the rows before it and its own demands ask for more seats than there are.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable, Sequence
from heapq import heappop, heappush
from typing import Any, TypeAlias

from mrbt_mesh.core.incremental.consistency.slots import HallWitness, Pool, Row, SlotGroup, by_label

# In the order in which they were made: (robot, from, to), pool None: nobody; or (0, robbed ask).
_Move: TypeAlias = "tuple[int, Pool | None, Pool] | tuple[int, SlotGroup]"


class Matching:
    """Rows in the order of their labels, each kept if it fits together with those kept before.

    After changes, `settle` decides again what they may have changed: in order of the labels, with
    robots that sit for later rows as good as free. `flips` counts decisions that turned.
    """

    def __init__(self, free: int = 0) -> None:
        self.free = free
        self.open = free
        self.rows: dict[int, Row] = {}
        self.flips = 0
        self.witnesses: list[HallWitness] = []
        self._pools: dict[int, Pool] = {}
        self._owners: list[Pool | None] = [None] * (free.bit_length() + 1)
        self._due: list[int] = []
        self._last_rejected = -1
        self._kept: list[int] = []  # labels, sorted

    # -- changes ------------------------------------------------------------------------------

    def add_row(self, row: Row, asks: Iterable[tuple[int, int]]) -> None:
        """A new row with its (robots, seats needed); it is decided by `settle` or `decide`."""
        row.asks = [SlotGroup(row, self._pool(robots), need) for robots, need in asks]
        self.rows[row.label] = row

    def due(self, row: Row) -> None:
        """Let `settle` look at this row."""
        row.wanted = True
        heappush(self._due, row.label)

    def remove_row(self, row: Row) -> None:
        self.withdraw(row)
        for ask in row.asks:
            self._leave(ask.pool)
        del self.rows[row.label]

    def withdraw(self, row: Row) -> None:
        """A row is not kept, whatever fits, until it is due again."""
        row.wanted = False
        if row.kept:
            self._release(row)
        elif row.witness is not None:
            self._leave_witness(row)

    def add_robot(self, robot: int) -> None:
        """One more robot is free."""
        self.free |= robot
        self.open |= robot
        short = robot.bit_length() + 1 - len(self._owners)
        self._owners.extend([None] * short)
        for witness in self.witnesses:
            if witness.robots & robot:
                witness.change(0, -1)
                self._call(witness, 0)

    def remove_robot(self, robot: int) -> None:
        """A robot is no longer free; the last row of its pool is in want of another."""
        self.free ^= robot
        for witness in self.witnesses:
            if witness.robots & robot:
                witness.change(0, 1)
        if self.open & robot:
            self.open ^= robot
            return
        pool = self._owners[robot.bit_length()]
        assert pool is not None
        pool.seats ^= robot
        self._rob(pool)

    def set_free(self, free: int) -> None:
        """Other robots are free; those that are not and have a seat keep it."""
        self.free = free
        self.open = free
        for pool in self._pools.values():
            self.open &= ~pool.seats
        self.witnesses.clear()

    def widen(self, robot: int, wider: Sequence[int]) -> None:
        """Before the robots that some rows may have become `wider` by a new robot: witnesses that
        this would break count it in.
        """
        for witness in self.witnesses:
            known = witness.robots | robot
            if any(robots | known == known for robots in wider):
                witness.robots = known
                if self.free & robot:
                    witness.change(0, -1)
                    self._call(witness, 0)

    def set_need(self, ask: SlotGroup, need: int) -> None:
        """Another number of seats."""
        row, more = ask.row, need - ask.need
        if not row.kept:
            ask.need = need
            self._decide_anew(row)
            return
        ask.need = need
        self._asked(ask.pool.robots, more, row.label)
        if ask.got > need:
            self._give_up(ask, ask.got - need)
        elif ask.got < need:
            self.due(row)

    def set_robots(self, ask: SlotGroup, robots: int) -> None:
        """Other robots can meet this demand."""
        row, old, new = ask.row, ask.pool, self._pool(robots)
        if row.kept:
            self._asked(new.robots, ask.need, row.label)
            self._asked(old.robots, -ask.need, row.label)
            seats, got = old.seats & new.robots, 0
            while seats and got < ask.got:
                robot = seats & -seats
                seats ^= robot
                old.seats ^= robot
                new.seats ^= robot
                self._owners[robot.bit_length()] = new
                got += 1
            self._give_up(ask, ask.got - got)
            if got:
                old.asks.remove(ask)
                ask.got = got
                insort(new.asks, ask, key=by_label)
            if got < ask.need:
                self.due(row)
        ask.pool = new
        self._leave(old)
        if not row.kept:
            self._decide_anew(row)

    def grow(self, pool: Pool, robot: int) -> None:
        """After `widen`: the new robot can meet all demands of a pool."""
        del self._pools[pool.robots]
        pool.robots |= robot
        self._pools[pool.robots] = pool

    def can_grow(self, pool: Pool, robot: int, users: int) -> bool:
        """Whether `grow` does for so many asks of a pool what `set_robots` would do for each."""
        return users == pool.users and pool.robots | robot not in self._pools

    def _decide_anew(self, row: Row) -> None:
        if row.wanted:
            self._leave_witness(row)
            self.due(row)

    def _pool(self, robots: int) -> Pool:
        pool = self._pools.get(robots)
        if pool is None:
            pool = self._pools[robots] = Pool(robots)
        pool.users += 1
        return pool

    def _leave(self, pool: Pool) -> None:
        pool.users -= 1
        if not pool.users:
            del self._pools[pool.robots]

    # -- decisions ----------------------------------------------------------------------------

    def settle(self) -> None:
        """Decide all that is due, and what follows from it."""
        due = self._due
        while due:
            row = self.rows.get(heappop(due))
            if row is None or not row.wanted:
                continue
            if row.kept:
                if row.lacks:
                    self.decide(row)
            elif row.witness is None:
                self.decide(row)
            else:
                witness = row.witness
                index = bisect_left(witness.labels, row.label)
                if witness.lacks[index] <= 0:
                    self._leave_witness(row)
                    self.decide(row)
                else:
                    self._call(witness, index + 1)

    def decide(self, row: Row) -> bool:
        """Keep a row if it fits; every row kept before it has all its seats."""
        was_kept, failure = row.kept, self._seat(row, [])
        if failure is None:
            if not was_kept:
                row.kept = True
                self.flips += 1
                insort(self._kept, row.label)
                for ask in row.asks:
                    self._asked(ask.pool.robots, ask.need, row.label)
            return True
        if was_kept:
            self._release(row)
        self._reject(row, *failure)
        return False

    def fits(self, row: Row) -> bool:
        """Whether `decide` would keep a new row."""
        moves: list[_Move] = []
        if self._seat(row, moves) is not None:
            return False
        self._undo(moves)
        self._reset(row, [0] * len(row.asks))
        return True

    def may_help(self, robots: int) -> bool:
        """Whether some rejected row might be kept if these robots were free as well."""
        shared = ((witness, witness.robots & robots) for witness in self.witnesses)
        return any(both and min(w.lacks) <= both.bit_count() for w, both in shared)

    def matched(self) -> dict[int, Any]:
        """Robot -> source of the row that it is kept for."""
        found = {}
        for pool in self._pools.values():
            seats = pool.seats
            for ask in pool.asks:
                for _ in range(ask.got):
                    robot = seats & -seats
                    seats ^= robot
                    found[robot] = ask.row.source
        return found

    def _seat(self, row: Row, moves: list[_Move]) -> tuple[HallWitness | int, int] | None:
        """Give a row all its seats; or (witness or robots for one, how many it lacks of them)."""
        before = [ask.got for ask in row.asks]
        dead: list[int] | None = None
        for ask in row.asks:
            pool = ask.pool
            while ask.got < ask.need:
                found = pool.robots & self.open
                if found:
                    self._take(found & -found, pool, moves)
                else:
                    if dead is None:
                        known, dead = self._known(row)
                        if known is not None:
                            self._undo(moves)
                            self._reset(row, before)
                            return known
                    reached = self._augment(pool, row.label, dead, moves)
                    if reached is not None:
                        lack = sum(
                            each.need - each.got
                            for each in row.asks
                            if each.pool.robots & reached == each.pool.robots
                        )
                        self._undo(moves)
                        self._reset(row, before)
                        return reached, lack
                ask.got += 1
                if ask.got == 1:
                    insort(pool.asks, ask, key=by_label)
        return None

    def _reset(self, row: Row, before: Sequence[int]) -> None:
        for ask, got in zip(row.asks, before, strict=True):
            if ask.got and not got:
                ask.pool.asks.remove(ask)
            ask.got = got

    def _known(self, row: Row) -> tuple[tuple[HallWitness, int] | None, list[int]]:
        """What the witnesses tell of a row: ((one that it cannot be kept, how many it lacks) or
        None, sets of robots none of which can be had at its label, whoever else changes seats).
        """
        label, dead = row.label, list[int]()
        asks = [(ask.pool.robots, ask.need) for ask in row.asks]
        for place, witness in enumerate(self.witnesses):
            robots, need = witness.robots, 0
            for able, count in asks:
                if able & robots == able:
                    need += count
            spare = witness.spare(label)
            if spare is None and need:
                spare = self._spare_before(witness, label)
            if spare is None:
                continue
            if need > spare:
                if place:  # it may well show the same for the next one
                    self.witnesses.insert(0, self.witnesses.pop(place))
                return (witness, need - spare), dead
            if spare <= 0:
                dead.append(robots)
        return None, dead

    def _spare_before(self, witness: HallWitness, label: int) -> int | None:
        """`Witness.spare` where all rows are later: what is kept from here on is spare as well."""
        spare = witness.needs[0] - witness.lacks[0]
        start = bisect_left(self._kept, label)
        end = bisect_left(self._kept, witness.labels[0], start)
        if end - start > 8:
            return None
        return spare + sum(witness.needed(self.rows[each]) for each in self._kept[start:end])

    def _augment(
        self, start: Pool, label: int, dead: Sequence[int], moves: list[_Move]
    ) -> int | None:
        """One more seat for a pool; others change seats, or one after `label` loses one.

        Returns the robots that it could not get beyond, None on success.
        """
        if start.asks and start.asks[-1].row.label > label:
            self._rob(start, moves)
            return None
        goal = self.open | self._later(label)
        unseen = self.free & ~start.seats
        for robots in dead:
            unseen &= ~robots
        owners = self._owners
        entered: dict[Pool, tuple[int, Pool] | None] = {start: None}
        if start.robots & goal:
            self._finish(start, start.robots & goal, entered, moves)
            return None
        queue = [start]
        for pool in queue:
            found = pool.robots & unseen
            unseen ^= found
            while found:
                robot = found & -found
                owner = owners[robot.bit_length()]
                assert owner is not None
                found ^= found & owner.seats
                unseen ^= unseen & owner.seats
                entered[owner] = (robot, pool)
                if owner.asks[-1].row.label > label:
                    self._rob(owner, moves)
                    self._shift(owner, entered, moves)
                    return None
                if owner.robots & goal:
                    self._finish(owner, owner.robots & goal, entered, moves)
                    return None
                queue.append(owner)
        reached = 0
        for pool in queue:
            reached |= pool.robots
        met = reached & self.free
        for robots in dead:
            if robots & met:
                reached |= robots
        return reached

    def _later(self, label: int) -> int:
        """Robots that sit for later rows, or might as well; 0 where there are many such rows."""
        start = bisect_right(self._kept, label)
        robots = 0
        if len(self._kept) - start <= 48:
            for each in self._kept[start:]:
                for ask in self.rows[each].asks:
                    robots |= ask.pool.seats if ask.got else 0
        return robots

    def _finish(
        self,
        pool: Pool,
        hit: int,
        entered: dict[Pool, tuple[int, Pool] | None],
        moves: list[_Move],
    ) -> None:
        """The way ends with a pool that can have one of the robots `hit`."""
        robot = hit & self.open or hit
        robot &= -robot
        if robot & self.open:
            self._take(robot, pool, moves)
        else:
            victim = self._owners[robot.bit_length()]
            assert victim is not None
            entered[victim] = (robot, pool)
            self._rob(victim, moves)
            pool = victim
        self._shift(pool, entered, moves)

    def _take(self, robot: int, pool: Pool, moves: list[_Move]) -> None:
        self.open ^= robot
        pool.seats ^= robot
        self._owners[robot.bit_length()] = pool
        moves.append((robot, None, pool))

    def _shift(
        self, pool: Pool, entered: dict[Pool, tuple[int, Pool] | None], moves: list[_Move]
    ) -> None:
        """Along the way back to the start, each pool hands a robot on to the one before it."""
        step = entered[pool]
        while step is not None:
            robot, taker = step
            pool.seats ^= robot
            taker.seats ^= robot
            self._owners[robot.bit_length()] = taker
            moves.append((robot, pool, taker))
            pool, step = taker, entered[taker]

    def _rob(self, pool: Pool, moves: list[_Move] | None = None) -> None:
        """The last row of a pool is left with one seat less."""
        ask = pool.asks[-1]
        ask.got -= 1
        if not ask.got:
            pool.asks.pop()
        heappush(self._due, ask.row.label)
        if moves is not None:
            moves.append((0, ask))

    def _undo(self, moves: list[_Move]) -> None:
        for move in reversed(moves):
            if len(move) == 2:
                ask = move[1]
                ask.got += 1
                if ask.got == 1:
                    insort(ask.pool.asks, ask, key=by_label)
                continue
            robot, source, pool = move
            pool.seats ^= robot
            self._owners[robot.bit_length()] = source
            if source is None:
                self.open ^= robot
            else:
                source.seats ^= robot

    def _give_up(self, ask: SlotGroup, count: int) -> None:
        """So many seats of an ask are free."""
        pool = ask.pool
        ask.got -= count
        if count and not ask.got:
            pool.asks.remove(ask)
        for _ in range(count):
            robot = pool.seats & -pool.seats
            pool.seats ^= robot
            self.open |= robot

    # -- rejected rows ------------------------------------------------------------------------

    def _release(self, row: Row) -> None:
        """A row is no longer kept."""
        row.kept = False
        self.flips += 1
        del self._kept[bisect_left(self._kept, row.label)]
        for ask in row.asks:
            self._give_up(ask, ask.got)
            self._asked(ask.pool.robots, -ask.need, row.label)

    def _reject(self, row: Row, shown_by: HallWitness | int, lack: int) -> None:
        if isinstance(shown_by, HallWitness):
            witness = shown_by
        else:
            witness = HallWitness(shown_by)
            self._absorb(witness, row, lack)
            self.witnesses.insert(0, witness)
        witness.add(row.label, witness.needed(row), lack)
        row.witness = witness
        self._last_rejected = max(self._last_rejected, row.label)

    def _absorb(self, witness: HallWitness, first: Row, lack: int) -> None:
        """Later rows whose witnesses lie within a new one go over to it where it holds for them."""
        spare = witness.needed(first) - lack
        for other in [w for w in self.witnesses if w.robots | witness.robots == witness.robots]:
            for index in range(len(other.labels) - 1, -1, -1):
                label = other.labels[index]
                if label < first.label:
                    break
                row = self.rows[label]
                need = witness.needed(row)
                if need > spare:
                    other.remove(label)
                    witness.add(label, need, need - spare)
                    row.witness = witness
            if other.labels:
                self._call(other, 0)
            else:
                self.witnesses.remove(other)

    def _leave_witness(self, row: Row) -> None:
        witness = row.witness
        if witness is not None:
            row.witness = None
            witness.remove(row.label)
            if witness.labels:
                self._call(witness, 0)
            else:
                self.witnesses.remove(witness)

    def _asked(self, robots: int, more: int, label: int) -> None:
        """A kept row asks for `more` (or fewer) of these robots: later witnesses lack more."""
        if label >= self._last_rejected or not more:
            return
        for witness in self.witnesses:
            if robots & witness.robots == robots:
                start = bisect_right(witness.labels, label)
                witness.change(start, more)
                if more < 0:
                    self._call(witness, start)

    def _call(self, witness: HallWitness, start: int) -> None:
        """The first row that a witness no longer holds for is to be looked at again."""
        label = witness.first_broken(start)
        if label is not None:
            heappush(self._due, label)
