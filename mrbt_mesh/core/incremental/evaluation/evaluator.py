"""Evaluating again: only what changed facts can influence is looked at.

`IncrementalEvaluator` follows one team's facts and keeps what its last tick has found. Leaves that
read a changed fact are looked at again; a node whose status changes tells its parent, which goes on
from what it knows of its other children. Whatever is reached anew, or under another name, is
ticked as from scratch. The result is that of `Evaluator`, which is the definition.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

from mrbt_mesh.core.bt.activation import Activation
from mrbt_mesh.core.bt.evaluation import Evaluation, EvaluationFacts
from mrbt_mesh.core.bt.tree import Tree
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.incremental.evaluation.compiled_evaluator import (
    CompiledEvaluator,
    evaluation_of,
    failure_of,
    request_of,
    timeout_of,
)
from mrbt_mesh.core.incremental.evaluation.fact_changes import FactChanges, PruneCandidates
from mrbt_mesh.core.incremental.evaluation.tick import Tick
from mrbt_mesh.core.incremental.evaluation.turn_sums import TurnSums
from mrbt_mesh.core.incremental.evaluation.update import Ranks, TickUpdate

_Item = TypeVar("_Item")


class IncrementalEvaluator(CompiledEvaluator):
    """An evaluator for the facts of one team; for any others it starts from scratch."""

    def __init__(self, tree: Tree, facts: TeamFacts) -> None:
        super().__init__(tree)
        self._facts = facts
        self._changes = FactChanges(facts)
        self._candidates = PruneCandidates(facts)
        self._sums = TurnSums(self.layout)
        self._set: dict[str, None] = {}
        self._turned: dict[int, None] = {}
        self._state: _State | None = None

    def find_obsolete(
        self, known: Iterable[Activation], facts: EvaluationFacts
    ) -> Iterable[Activation]:
        if facts is self._facts:
            known = self._candidates.take(self.renamed_ranges)
        return super().find_obsolete(known, facts)

    def forget(self) -> None:
        """Start from scratch next time."""
        self._state = None

    def turns_at(self, node: int, facts: EvaluationFacts) -> int:
        if facts is not self._facts:
            return super().turns_at(node, facts)
        self._read_conditions()
        return self._sums.at(node)

    def evaluate(self, facts: EvaluationFacts) -> Evaluation:
        """Tick the tree once."""
        if facts is not self._facts:
            return super().evaluate(facts)
        self._read_conditions()
        changes, state = self._changes, self._state
        if state is None:
            tick = Tick(self.layout, self.functions, facts, self._sums.turned)
            state = _State(tick, self._sums)
        elif self._set or changes:
            self._state = None  # in case that reading the facts raises
            state.update.read(self._set)
            state.update.restart(self._turned)
            state.update.look_at(changes.nodes, changes.child_results)
            state.update.run()
            state.take()
        self._state = state
        changes.clear()
        self._set.clear()
        self._turned.clear()
        return state.evaluation

    def _read_conditions(self) -> None:
        """Count how often guards have turned; what else follows waits for the evaluation."""
        for name in self._changes.conditions:
            self._set[name] = None
            for guard in self.layout.guards_of.get(name, ()):
                if self._sums.set(guard, self._facts.turns(*self.layout.guards[guard])):
                    self._turned[guard] = None
        self._changes.conditions.clear()


class _State:
    """What the last tick has found, and what follows from it."""

    def __init__(self, tick: Tick, sums: TurnSums) -> None:
        self.tick = tick
        self._requests = _Shown(tick, tick.asking, request_of)
        self._timeouts = _Shown(tick, tick.watching, timeout_of)
        self._failures = _Shown(tick, tick.failed, failure_of)
        tick.tick(0, 0, "")
        self.update = TickUpdate(tick, sums)
        self.update.rewritten.append((0, tick.layout.ranks[0], 0))
        self.evaluation = self.take()

    def take(self) -> Evaluation:
        """What follows from what the update has moved and rewritten."""
        moved, rewritten = self.update.moved, self.update.rewritten
        layout, is_live = self.tick.layout, self.tick.liveness()
        begun = [(layout.firsts[node], layout.ranks[node], node) for node in moved]
        shown = _widest(begun + rewritten)
        requests = self._requests.update(shown, is_live)
        timeouts = self._timeouts.update(shown, is_live)
        failures = self._failures.update(_widest(rewritten), _always)
        self.evaluation = evaluation_of(self.tick, is_live, requests, timeouts, failures)
        moved.clear()
        rewritten.clear()
        return self.evaluation


def _always(node: int) -> bool:
    return True


def _widest(ranges: list[Ranks]) -> list[Ranks]:
    """Those that are not within another one; two of them are apart, or one is within the other."""
    if len(ranges) < 2:
        return ranges
    found: list[Ranks] = []
    for each in sorted(ranges, key=lambda ranks: (ranks[0], -ranks[1])):
        if not found or each[1] > found[-1][1]:
            found.append(each)
    return found


class _Shown(Generic[_Item]):
    """Of a sorted list of ranks, those of nodes that are live, and what each stands for."""

    def __init__(self, tick: Tick, ranks: list[int], make: Callable[[Tick, int], _Item]) -> None:
        self._tick = tick
        self._ranks = ranks
        self._make = make
        self._shown: list[int] = []
        self._items: list[_Item] = []
        self._all: tuple[_Item, ...] = ()

    def update(self, ranges: Iterable[Ranks], is_live: Callable[[int], bool]) -> tuple[_Item, ...]:
        """Look again at what has these ranks; returns all."""
        if not (self._ranks or self._shown):
            return self._all
        by_rank = self._tick.layout.by_rank
        has_changed = False
        for low, high, above in ranges:
            first = bisect_left(self._shown, low)
            end = bisect_right(self._shown, high, first)
            start = bisect_left(self._ranks, low)
            fresh = self._ranks[start : bisect_right(self._ranks, high, start)]
            if fresh:
                fresh = [r for r in fresh if is_live(by_rank[r])] if is_live(above) else []
            if fresh or first != end:
                self._shown[first:end] = fresh
                self._items[first:end] = [self._make(self._tick, rank) for rank in fresh]
                has_changed = True
        if has_changed:
            self._all = tuple(self._items)
        return self._all
