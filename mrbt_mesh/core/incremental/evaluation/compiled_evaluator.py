"""Evaluating a tree from scratch over flat lists: as `bt.evaluator` does, several times faster."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from mrbt_mesh.core.bt.evaluation import Evaluation, EvaluationFacts, Request, RunningTimeout
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import Guard
from mrbt_mesh.core.bt.tree import Tree
from mrbt_mesh.core.incremental.evaluation.compiled_tree import CompiledTree
from mrbt_mesh.core.incremental.evaluation.node_functions import node_functions
from mrbt_mesh.core.incremental.evaluation.tick import Tick


class CompiledEvaluator(Evaluator):
    """Evaluates one tree; what it keeps is derived from the tree alone, never from facts."""

    def __init__(self, tree: Tree) -> None:
        super().__init__(tree)
        self.layout = CompiledTree(self)
        self.functions = node_functions(self.layout)

    def turns_at(self, node: int, facts: EvaluationFacts) -> int:
        guards = self.layout.guards
        return sum(facts.turns(*guards[number]) for number in self.layout.guards_at(node))

    def renamed_ranges(
        self, turned: Iterable[Guard], loops: Iterable[int]
    ) -> list[tuple[int, int]]:
        """First and last nodes of ranges that hold all whose activations may have other names.

        `turned`: conditions that have turned to these values; `loops`: Retry and Repeat nodes whose
        attempt numbers have changed.
        """
        layout = self.layout
        found = [(loop + 1, layout.ends[loop]) for loop in loops]
        for guard in turned:
            found += layout.turned_reach(*guard)
        return found

    def evaluate(self, facts: EvaluationFacts) -> Evaluation:
        """Tick the tree once."""
        layout = self.layout
        turned = [facts.turns(name, value) for name, value in layout.guards]
        tick = Tick(layout, self.functions, facts, turned)
        tick.tick(0, 0, "")
        is_live = tick.liveness()
        asking, watching = tick.asking, tick.watching
        if tick.hides:
            asking = [rank for rank in asking if is_live(layout.by_rank[rank])]
            watching = [rank for rank in watching if is_live(layout.by_rank[rank])]
        return evaluation_of(
            tick,
            is_live,
            tuple(request_of(tick, rank) for rank in asking),
            tuple(timeout_of(tick, rank) for rank in watching),
            tuple(failure_of(tick, rank) for rank in tick.failed),
        )


def evaluation_of(
    tick: Tick,
    is_live: Callable[[int], bool],
    requests: tuple[Request, ...],
    timeouts: tuple[RunningTimeout, ...],
    failures: tuple[str, ...],
) -> Evaluation:
    """What a tick has found, given what is asked for."""
    latches, kept = tick.said(0, tick.layout.ends[0])
    return Evaluation(
        bytes(tick.statuses),
        requests,
        timeouts,
        tuple(latches),
        failures,
        (*tick.passed(is_live), *kept),
    )


def request_of(tick: Tick, rank: int) -> Request:
    """What the action with this rank asks for."""
    node = tick.layout.by_rank[rank]
    name, known = tick.names[node], tick.asked[node]
    if known is None or known.activation is not name:
        known = tick.asked[node] = Request(node, tick.layout.subjects[node], name)
    return known


def timeout_of(tick: Tick, rank: int) -> RunningTimeout:
    """What the Timeout with this rank waits for."""
    node = tick.layout.by_rank[rank]
    name, known = tick.names[node], tick.watched[node]
    if known is None or known.activation is not name:
        timeout_us = tick.layout.tree.nodes[node].timeout_us
        known = tick.watched[node] = RunningTimeout(node, name, timeout_us)
    return known


def failure_of(tick: Tick, rank: int) -> str:
    """The activation of the action with this rank."""
    return tick.names[tick.layout.by_rank[rank]]
