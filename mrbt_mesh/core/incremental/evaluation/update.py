"""Bringing a tick up to date: nodes that read a changed fact, and what follows upwards.

Nodes are looked at by falling index, so children before their parents; a parent goes on from what
it knows of its other children. What is reached anew, or under another name, is ticked as from
scratch.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Callable, Iterable, Mapping
from heapq import heappop, heappush
from typing import TypeAlias

from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, Kind
from mrbt_mesh.core.incremental.evaluation.tick import (
    FAILURE,
    RUNNING,
    STATUS_BITS,
    SUCCESS,
    UNARY,
    Tick,
    branch_of,
)
from mrbt_mesh.core.incremental.evaluation.turn_sums import TurnSums

# First and last rank of subtrees, and a node that must be live for anything in them to be so.
Ranks: TypeAlias = tuple[int, int, int]


class TickUpdate:
    """Brings a tick up to date, as often as one likes.

    `moved` are nodes that have begun or ceased to run, but not all of them below another one;
    `rewritten` are subtrees of which leaves were ticked anew. Whoever has read them clears them.
    """

    def __init__(self, tick: Tick, sums: TurnSums) -> None:
        layout = tick.layout
        self.moved: list[int] = []
        self.rewritten: list[Ranks] = []
        self._tick = tick
        self._layout = layout
        self._sums = sums
        # For short, since they are read at every node.
        self._statuses, self._acted = tick.statuses, tick.acted
        self._parents, self._children = layout.parents, layout.children
        self._passing = tick.functions.passing
        self._refresh = [_REFRESH[kind] for kind in layout.kinds]
        self._is_parallel = [kind is Kind.PARALLEL for kind in layout.kinds]
        self._positions, self._stops = layout.positions, tick.stops
        # The last position of a Sequence or Fallback that does not remember, -1 of other nodes.
        in_order = zip(layout.kinds, layout.children, layout.remembering, strict=True)
        self._lasts = [
            len(children) - 1 if kind in (Kind.SEQUENCE, Kind.FALLBACK) and not remembering else -1
            for kind, children, remembering in in_order
        ]
        self._heap: list[int] = []
        self._queued: set[int] = set()
        # Of a Sequence or Fallback: the first changed position that decides, and the first one
        # whose guards have turned; of an IfThenElse, such a branch.
        self._decided: dict[int, int] = {}
        self._restarts: dict[int, int] = {}
        self._told: set[int] = set()

    def _push(self, node: int) -> None:
        if node not in self._queued:
            self._queued.add(node)
            heappush(self._heap, -node)

    def read(self, conditions: Iterable[str]) -> None:
        """These conditions have been set."""
        readers = self._layout.readers
        for name in conditions:
            for node in readers.get(name, ()):
                self._push(node)

    def restart(self, guards: Iterable[int]) -> None:
        """These guards have turned: what they guard has other names."""
        layout = self._layout
        for guard in guards:
            for entry in layout.entries[guard]:
                if self._statuses[entry]:
                    parent, position = layout.parents[entry], layout.positions[entry]
                    known = self._restarts.get(parent, position)
                    self._restarts[parent] = min(known, position)
                    self._push(parent)

    def look_at(self, nodes: Iterable[int], told: Iterable[tuple[int, int]]) -> None:
        """Something was said of these nodes, and of how the children at these positions ended."""
        children = self._children
        for node in nodes:
            if 0 <= node < len(children):
                self._push(node)
        for node, position in told:
            if 0 <= node < len(children) and position < len(children[node]):
                self._told.add(children[node][position])
                self._push(children[node][position])

    def run(self) -> None:
        """Look at all of them, and at what follows."""
        tick, heap, statuses = self._tick, self._heap, self._statuses
        skipped, remembering = tick.skipped, self._layout.remembering
        for node in tick.past:
            self._push(node)  # its earlier rounds have read facts that nobody follows
        while heap:
            node = -heappop(heap)
            if not statuses[node] or (node in self._told and self._recall(node)):
                continue
            if not skipped[node]:
                self._refresh[node](self, node)
                if remembering[node]:
                    tick.report(node)
        for done in (self._queued, self._told, self._decided, self._restarts):
            done.clear()

    # -- what has changed -----------------------------------------------------------------

    def _settle(self, node: int, status: int, acted: int) -> None:
        """A node has this status now; if it is another one, its parent is told.

        A Sequence or Fallback takes the status of the child at which it stops. So it goes for
        most of the way up, for which the loop is.
        """
        statuses, acteds, heap = self._statuses, self._acted, self._heap
        acting, moved, ends = self._tick.acting, self.moved, self._layout.ends
        while True:
            before, acted_before = statuses[node], acteds[node]
            if status == before and acted == acted_before:
                return
            statuses[node], acteds[node] = status, acted
            if (status == RUNNING) is not (before == RUNNING):
                if moved and node < moved[-1] <= ends[node]:
                    moved[-1] = node
                else:
                    moved.append(node)
            parent = self._parents[node]
            if parent < 0:
                return
            if self._lasts[parent] < 0 or (heap and -heap[0] >= parent):
                break  # its other children may change as well
            position = self._positions[node]
            if position != self._stops[parent] or (
                status == self._passing[parent] and position != self._lasts[parent]
            ):
                break
            acting[parent] += acted - acted_before
            node, acted = parent, acting[parent] > 0
        if self._layout.recalled[node]:
            ended = self._tick.ended.setdefault(parent, {})
            if status == RUNNING:
                ended.pop(self._positions[node], None)
            else:
                ended[self._positions[node]] = status == SUCCESS
        self._tell(node, before, acted_before)

    def _tell(self, node: int, before: int, acted_before: int) -> None:
        """The parent's count of its children."""
        parent, status, tick = self._parents[node], self._statuses[node], self._tick
        if self._is_parallel[parent]:
            tick.successes[parent] += (status == SUCCESS) - (before == SUCCESS)
            tick.failures[parent] += (status == FAILURE) - (before == FAILURE)
        elif status != self._passing[parent]:
            position = self._positions[node]
            if self._decided.get(parent, position) >= position:
                self._decided[parent] = position
        tick.acting[parent] += self._acted[node] - acted_before
        if parent not in self._queued:
            self._queued.add(parent)
            heappush(self._heap, -parent)

    def _clear(self, node: int, first: int, last: int) -> None:
        """Children of `node` at these positions are not ticked any more."""
        tick, children = self._tick, self._children[node]
        ended = tick.ended.get(node)
        for position in range(first, last + 1):
            tick.acting[node] -= tick.acted[children[position]]
            if ended:
                ended.pop(position, None)
        begin, end = children[first], tick.layout.ends[children[last]]
        tick.clear(begin, end)
        self._rewrite(node, first, last)

    def _rewrite(self, node: int, first: int, last: int) -> None:
        layout = self._layout
        children = layout.children[node]
        ranks = self._tick.ranks(children[first], layout.ends[children[last]])
        self.rewritten.append((*ranks, node))

    def _tick_anew(self, node: int) -> None:
        tick, turns = self._tick, self._sums.at(node)
        text = tick.text(node)
        tick.amid(lambda: tick.tick(node, turns, text))

    def _recall(self, node: int) -> bool:
        """Look again at how a child of a node with memory ended; False: as before."""
        tick, layout = self._tick, self._layout
        parent, position = layout.parents[node], layout.positions[node]
        if not layout.recalled[node]:
            return False
        said = tick.facts.child_result(tick.names[parent], position)
        if said is None and not tick.skipped[node]:
            return False
        before, acted_before = tick.statuses[node], tick.acted[node]
        tick.ended.get(parent, {}).pop(position, None)
        tick.clear(node, layout.ends[node])
        self._tick_anew(node)
        self._rewrite(parent, position, position)
        self._tell(node, before, acted_before)
        return True

    # -- by kind --------------------------------------------------------------------------

    def _condition(self, node: int) -> None:
        holds = self._tick.facts.condition(self._tick.layout.subjects[node])
        self._settle(node, SUCCESS if holds else FAILURE, 0)

    def _action(self, node: int) -> None:
        tick, layout = self._tick, self._layout
        status = int(tick.facts.task_status(layout.subjects[node], tick.names[node]))
        before, rank = tick.statuses[node], layout.ranks[node]
        for wanted, ranks in ((RUNNING, tick.asking), (FAILURE, tick.failed)):
            _keep(ranks, rank, before == wanted, status == wanted)
        if FAILURE in (status, before):
            self.rewritten.append((rank, rank, node))
        self._settle(node, status, status != RUNNING)

    def _unary(self, node: int) -> None:
        child = self._children[node][0]
        status = self._tick.functions.unary[node][self._statuses[child]]
        self._settle(node, status, self._acted[child])

    def _timeout(self, node: int) -> None:
        tick, layout = self._tick, self._layout
        child = layout.children[node][0]
        status, acted = tick.statuses[child], tick.acted[child]
        if status == RUNNING and tick.facts.has_expired(tick.names[node]):
            status, acted = FAILURE, 1
        running = tick.statuses[node] == RUNNING
        _keep(tick.watching, layout.ranks[node], running, status == RUNNING)
        self._settle(node, status, acted)

    def _loop(self, node: int) -> None:
        tick, layout = self._tick, self._layout
        child, limit = layout.children[node][0], layout.limits[node]
        recorded = tick.facts.attempts_used(tick.names[node])
        attempt = recorded if limit < 0 else min(recorded, limit - 1)
        status, acted = tick.statuses[child], tick.acted[child]
        is_used_up = status == tick.functions.passing[node] and acted and attempt + 1 != limit
        tick.past.pop(node, None)
        tick.latches.pop(node, None)
        if attempt == tick.attempts[node] and not is_used_up:
            self._settle(node, tick.loop_status(node, status), acted)
            return
        tick.clear(child, layout.ends[child])
        self._rewrite(node, 0, 0)
        turns, text = self._sums.at(node), tick.text(node)
        code = tick.amid(lambda: tick.round(node, turns, text))
        self._settle(node, code & STATUS_BITS, code > STATUS_BITS)

    def _parallel(self, node: int) -> None:
        self._settle(node, self._tick.parallel(node), self._tick.acting[node] > 0)

    def _in_order(self, node: int) -> None:
        children, statuses, stops = self._children[node], self._statuses, self._stops
        count, stop, passing = len(children), stops[node], self._passing[node]
        restart = self._restarts.pop(node, count) if self._restarts else count
        decided = self._decided.pop(node, count)
        if decided < restart:
            if decided < stop:
                self._clear(node, decided + 1, stop)
                stops[node] = decided
        elif restart <= stop:
            self._clear(node, restart, stop)
            self._go_on(node, restart)
        elif stop + 1 < count and statuses[children[stop]] == passing:
            self._go_on(node, stop + 1)
        self._settle(node, statuses[children[stops[node]]], self._tick.acting[node] > 0)

    def _go_on(self, node: int, position: int) -> None:
        tick, layout = self._tick, self._layout
        child = layout.children[node][position - 1]
        turns, text = self._sums.at(child), tick.text(child)
        tick.amid(lambda: tick.advance(node, position, turns, text))
        self._rewrite(node, position, tick.stops[node])

    def _if_then_else(self, node: int) -> None:
        tick, children = self._tick, self._children[node]
        turned = self._restarts.pop(node, 0)
        before, branch = tick.stops[node], branch_of(tick.statuses[children[0]], len(children))
        if before and (before != branch or turned):
            self._clear(node, before, before)
            before = 0
        child = children[branch]
        if branch and not before:
            self._tick_anew(child)
            self._rewrite(node, branch, branch)
        tick.stops[node] = branch
        acted = tick.acted[children[0]] or tick.acted[child]
        self._settle(node, tick.statuses[child], acted)


def _keep(ranks: list[int], rank: int, has: bool, should: bool) -> None:
    """Put a rank into a sorted list, or take it out."""
    if should and not has:
        insort(ranks, rank)
    elif has and not should:
        del ranks[bisect_left(ranks, rank)]


_REFRESH: Mapping[Kind, Callable[[TickUpdate, int], None]] = {
    Kind.CONDITION: TickUpdate._condition,
    Kind.ACTION: TickUpdate._action,
    Kind.SEQUENCE: TickUpdate._in_order,
    Kind.FALLBACK: TickUpdate._in_order,
    Kind.PARALLEL: TickUpdate._parallel,
    Kind.IF_THEN_ELSE: TickUpdate._if_then_else,
    Kind.TIMEOUT: TickUpdate._timeout,
    **dict.fromkeys(UNARY, TickUpdate._unary),
    **dict.fromkeys(ATTEMPT_KINDS, TickUpdate._loop),
}
