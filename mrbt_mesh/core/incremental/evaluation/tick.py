"""One tick of a tree: what it finds at every node. `node_functions` has how each kind is ticked.

A node's function returns its status, plus `ACTED` where outcomes decided it. Statuses are
numbers here, those of `Status`.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from mrbt_mesh.core.bt.evaluation import EvaluationFacts, Request, RunningTimeout
from mrbt_mesh.core.bt.evaluator import parallel_status
from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.core.incremental.evaluation.compiled_tree import CompiledTree

RUNNING, SUCCESS, FAILURE = int(Status.RUNNING), int(Status.SUCCESS), int(Status.FAILURE)
STATUS_BITS, ACTED = 3, 4

# By the child's status, the first being that of one that was not ticked.
UNARY: Mapping[Kind, tuple[int, int, int, int]] = {
    Kind.SUBTREE: (0, RUNNING, SUCCESS, FAILURE),
    Kind.INVERTER: (0, RUNNING, FAILURE, SUCCESS),
    Kind.FORCE_SUCCESS: (0, RUNNING, SUCCESS, SUCCESS),
    Kind.FORCE_FAILURE: (0, RUNNING, FAILURE, FAILURE),
}
# The status of a child on which the next one is ticked, or the same one again.
PASSING: Mapping[Kind, int] = {
    Kind.SEQUENCE: SUCCESS,
    Kind.FALLBACK: FAILURE,
    Kind.RETRY: FAILURE,
    Kind.REPEAT: SUCCESS,
    Kind.KEEP_RUNNING_UNTIL_FAILURE: SUCCESS,
}

Latch = tuple[str, int]
Passed = tuple[str, int, bool]


class Tick:
    """What one tick has found.

    By node: `statuses`; `acted`, whether outcomes decided it; `skipped`, whether it has ended
    before, as its parent remembers; `names` of the scopes of actions, loops, Timeouts and nodes
    with memory; `stops`, the last position that a Sequence, Fallback or IfThenElse has ticked;
    `acting`, how many of a control's children have acted; and how many of a Parallel's have
    succeeded or failed. Sorted ranks: `asking` of running actions, `watching` of running Timeouts,
    whether or not something above has finished, and `failed` of actions that have failed.
    `latches`, and `past`, what was said in earlier rounds of a loop, are attempts that were used
    up; `ended` the children that nodes with memory have done with, and `reporting` the nodes of
    which this must be remembered.
    """

    def __init__(
        self,
        layout: CompiledTree,
        functions: NodeFunctions,
        facts: EvaluationFacts,
        turned: Sequence[int],
    ) -> None:
        count = len(layout.parents)
        self.layout = layout
        self.functions = functions
        self.facts = facts
        self.turned = turned
        known = functions.known(facts.run)
        self.scopes, self.asked, self.watched = known.scopes, known.requests, known.timeouts
        self.statuses = bytearray(count)
        self.acted = bytearray(count)
        self.skipped = bytearray(count)
        self.names = [""] * count
        self.stops = [0] * count
        self.acting = [0] * count
        self.successes = [0] * count
        self.failures = [0] * count
        self.asking: list[int] = []
        self.watching: list[int] = []
        self.failed: list[int] = []
        # Whether anything asks below a node that has finished.
        self.hides = False
        self.attempts: dict[int, int] = {}
        self.texts: dict[int, str] = {}
        self.latches: dict[int, Latch] = {}
        self.past: dict[int, tuple[list[Latch], list[Passed]]] = {}
        self.ended: dict[int, dict[int, bool]] = {}
        self.reporting: dict[int, None] = {}

    def tick(self, node: int, turns: int, text: str) -> int:
        """Tick a node that has not been ticked: `turns` of its guards, attempts as a `text`."""
        return self.functions.ticks[node](self, node, turns, text)

    def amid(self, tick: Callable[[], int]) -> int:
        """Tick something amid what was ticked before, and put what it asks for in its place."""
        before = self.asking, self.watching, self.failed
        self.asking, self.watching, self.failed = [], [], []
        code = tick()
        for ranks, fresh in zip(before, (self.asking, self.watching, self.failed), strict=True):
            if fresh:
                place = bisect_left(ranks, fresh[0])
                ranks[place:place] = fresh
        self.asking, self.watching, self.failed = before
        return code

    def name(self, node: int, turns: int, text: str) -> str:
        """The name of what happens at a node; the same as last time if nothing has turned."""
        known = self.scopes[node]
        if known is None or known[0] != turns or known[1] != text:
            subject = self.layout.subjects[node]
            known = (turns, text, f"{self.facts.run}:{node}:{subject}:{text}:{turns}")
            self.scopes[node] = known
        return known[2]

    def text(self, node: int) -> str:
        """The attempt numbers around a node that was ticked."""
        loops = self.layout.loops[node]
        return self.texts[loops[-1]] if loops else ""

    def clear(self, first: int, last: int) -> None:
        """Forget the subtrees of neighbouring children, whose indices these are, first to last."""
        none = bytes(last + 1 - first)
        for flags in (self.statuses, self.acted, self.skipped):
            flags[first : last + 1] = none
        low, high = self.ranks(first, last)
        for ranks in (self.asking, self.watching, self.failed):
            begin = bisect_left(ranks, low)
            del ranks[begin : bisect_right(ranks, high, begin)]
        by_node: tuple[dict[int, Any], ...]
        by_node = (self.latches, self.past, self.ended, self.reporting)
        for known in by_node:
            if len(known) > last - first:
                nodes: Iterable[int] = range(first, last + 1)
            else:
                nodes = [node for node in known if first <= node <= last]
            for node in nodes:
                known.pop(node, None)

    def ranks(self, first: int, last: int) -> tuple[int, int]:
        """The ranks that neighbouring subtrees with these indices take."""
        depth = first - self.layout.firsts[first]
        return first - depth, last - depth

    # -- how kinds of nodes go on ---------------------------------------------------------

    def advance(self, node: int, position: int, turns: int, text: str) -> int:
        """Tick the children of a Sequence or Fallback from `position` on, until one decides.

        `turns` of the guards of the child before. Returns the status of the last one.
        """
        layout, ticks, turned = self.layout, self.functions.ticks, self.turned
        fresh, children = layout.fresh, layout.children[node]
        passing = self.functions.passing[node]
        acting, child, status = self.acting[node], -1, passing
        rest = children if not position else (children[p] for p in range(position, len(children)))
        for child in rest:
            for guard in fresh[child]:
                turns += turned[guard]
            status = ticks[child](self, child, turns, text)
            if status > STATUS_BITS:
                acting += 1
                status &= STATUS_BITS
            if status != passing:
                break
        self.stops[node] = layout.positions[child]
        self.acting[node] = acting
        return status

    def parallel(self, node: int) -> int:
        """The status of a Parallel, by the paper's rule."""
        layout = self.layout
        needed, children = layout.limits[node], layout.children[node]
        allowed = layout.tree.nodes[node].failures
        too_many = len(children) - self.failures[node] < needed or (
            0 < allowed <= self.failures[node]
        )
        if self.successes[node] < needed:
            return FAILURE if too_many else RUNNING
        if not too_many:
            return SUCCESS
        return parallel_status([Status(self.statuses[c]) for c in children], needed, allowed)

    def round(self, node: int, turns: int, text: str) -> int:
        """Tick the child of a Retry or Repeat until no attempt is used up any more.

        An attempt is used up by outcomes, never by a condition alone. Where conditions alone
        decide, all remaining attempts would end the same way at once: a limited node takes that
        status, one without a limit waits (RUNNING).
        """
        scope, child = self.names[node], self.layout.children[node][0]
        function, again = self.functions.ticks[child], self.functions.passing[node]
        limit, recorded = self.layout.limits[node], self.facts.attempts_used(scope)
        attempt = recorded if limit < 0 else min(recorded, limit - 1)
        while True:
            self.texts[node] = inner = f"{text}.{attempt}" if text else str(attempt)
            code = function(self, child, turns, inner)
            if code != again | ACTED or attempt + 1 == limit:
                break
            self._use_up(node, child)
            attempt += 1
        self.attempts[node] = attempt
        if attempt > recorded:
            self.latches[node] = (scope, attempt)
        return self.loop_status(node, code & STATUS_BITS) | code & ACTED

    def loop_status(self, node: int, status: int) -> int:
        """The status of a Retry or Repeat whose last attempt has this one."""
        waits = status == self.functions.passing[node] and self.layout.limits[node] < 0
        return RUNNING if waits else status

    def _use_up(self, node: int, child: int) -> None:
        """Begin another round: what was latched below stays, the attempt number says the rest."""
        last = self.layout.ends[child]
        latches, kept = self.said(child, last)
        past = self.past.setdefault(node, ([], []))
        past[0].extend(latches)
        past[1].extend(kept)
        self.clear(child, last)

    # -- what follows ---------------------------------------------------------------------

    def said(self, first: int, last: int) -> tuple[list[Latch], list[Passed]]:
        """Attempts used up, and successes that failed nodes keep, in the order of ticking."""
        layout = self.layout
        found: list[tuple[tuple[int, int, int], Sequence[Latch], Sequence[Passed]]] = []
        for node, (latches, kept) in self.past.items():
            if first <= node <= last:
                found.append(((layout.firsts[node], 0, node), latches, kept))
        for node, latch in self.latches.items():
            if first <= node <= last:
                found.append(((layout.ranks[node], 1, node), [latch], ()))
        for node in self.reporting:
            if first <= node <= last and self.statuses[node] == FAILURE:
                scope, ended = self.names[node], self.ended[node]
                kept = [(scope, position, True) for position in sorted(ended) if ended[position]]
                found.append(((layout.ranks[node], 1, node), (), kept))
        found.sort(key=lambda item: item[0])
        return [x for _, latches, _ in found for x in latches], [
            x for _, _, kept in found for x in kept
        ]

    def passed(self, is_live: Callable[[int], bool]) -> list[Passed]:
        """Children that running nodes with memory have done with."""
        found = [node for node in self.reporting if is_live(node)]
        found.sort(key=self.layout.ranks.__getitem__)
        return [
            (self.names[node], position, self.ended[node][position])
            for node in found
            for position in sorted(self.ended[node])
        ]

    def report(self, node: int) -> None:
        """Note whether a node with memory must have its children's ends remembered."""
        status = self.statuses[node]
        if self.ended.get(node) and (
            status == RUNNING or (status == FAILURE and self.layout.keeps(node))
        ):
            self.reporting[node] = None
        else:
            self.reporting.pop(node, None)

    def liveness(self) -> Callable[[int], bool]:
        """Whether a node and all above it are running: else nothing below is asked for."""
        known: dict[int, bool] = {-1: True}
        statuses, parents = self.statuses, self.layout.parents

        def is_live(node: int) -> bool:
            line = []
            while node not in known and statuses[node] == RUNNING:
                line.append(node)
                node = parents[node]
            found = known.get(node, False)
            for each in line:
                known[each] = found
            return found

        return is_live


# Turns, attempts as text, and the name that follows from them.
Scope = tuple[int, str, str]
Function = Callable[[Tick, int, int, str], int]


class Known:
    """By node, the name that it had last in a run, and what it asked for: to make them once."""

    def __init__(self, run: str, count: int) -> None:
        self.run = run
        self.scopes: list[Scope | None] = [None] * count
        self.requests: list[Request | None] = [None] * count
        self.timeouts: list[RunningTimeout | None] = [None] * count


class NodeFunctions:
    """The function that ticks each node of a tree.

    `ticks`: the whole; `inner`: of a node whose end its parent remembers, without asking the
    parent; `plain`: without the node's own memory. `passing`: the child's status on which it goes
    on; `unary`: its status by that of its child.
    """

    def __init__(
        self,
        plain: list[Function],
        inner: list[Function],
        ticks: list[Function],
        kinds: Sequence[Kind],
    ) -> None:
        self.plain, self.inner, self.ticks = plain, inner, ticks
        self.passing = [PASSING.get(kind, 0) for kind in kinds]
        self.unary = [UNARY.get(kind, ()) for kind in kinds]
        self._known = Known("", len(kinds))

    def known(self, run: str) -> Known:
        """The names of a run that were made before."""
        if self._known.run != run:
            self._known = Known(run, len(self.ticks))
        return self._known


def branch_of(status: int, count: int) -> int:
    """The branch of an IfThenElse that its condition's status chooses, 0: none."""
    branch = {SUCCESS: 1, FAILURE: 2}.get(status, 0)
    return branch if branch < count else 0
