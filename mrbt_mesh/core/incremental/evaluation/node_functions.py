"""How each kind of node is ticked: the rules of `bt.evaluator`, over flat lists."""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.incremental.evaluation.compiled_tree import CompiledTree
from mrbt_mesh.core.incremental.evaluation.tick import (
    ACTED,
    FAILURE,
    RUNNING,
    STATUS_BITS,
    SUCCESS,
    UNARY,
    Function,
    NodeFunctions,
    Tick,
    branch_of,
)


def node_functions(layout: CompiledTree) -> NodeFunctions:
    """The functions of all nodes of a tree."""
    plain = [_FUNCTIONS[kind] for kind in layout.kinds]
    inner = [
        _remembering if remembers else function
        for function, remembers in zip(plain, layout.remembering, strict=True)
    ]
    ticks = [
        _recalled if recalled else function
        for function, recalled in zip(inner, layout.recalled, strict=True)
    ]
    return NodeFunctions(plain, inner, ticks, layout.kinds)


def memory_text(layout: CompiledTree, node: int, text: str) -> str:
    """The attempts under which a node with memory remembers: a Retry changes nothing for one that
    remembers until it succeeds.
    """
    if not text or not layout.keeps(node):
        return text
    outer = zip(layout.loops[node], text.split("."), strict=True)
    return ".".join("0" if layout.kinds[loop] is Kind.RETRY else number for loop, number in outer)


def _condition(tick: Tick, node: int, turns: int, text: str) -> int:
    status = SUCCESS if tick.facts.condition(tick.layout.subjects[node]) else FAILURE
    tick.statuses[node] = status
    return status


def _action(tick: Tick, node: int, turns: int, text: str) -> int:
    layout = tick.layout
    known = tick.scopes[node]
    if known is not None and known[0] == turns and known[1] == text:
        name = known[2]
    else:
        name = tick.name(node, turns, text)
    tick.names[node] = name
    status: int = tick.facts.task_status(layout.subjects[node], name)
    tick.statuses[node] = status
    if status == RUNNING:
        tick.asking.append(layout.ranks[node])
        return status
    if status == FAILURE:
        tick.failed.append(layout.ranks[node])
    tick.acted[node] = 1
    return status | ACTED


def _in_order(tick: Tick, node: int, turns: int, text: str) -> int:
    tick.acting[node] = 0
    status = tick.advance(node, 0, turns, text)
    tick.statuses[node] = status
    if tick.acting[node]:
        tick.acted[node] = 1
        return status | ACTED
    return status


def _if_then_else(tick: Tick, node: int, turns: int, text: str) -> int:
    children, ticks = tick.layout.children[node], tick.functions.ticks
    code = ticks[children[0]](tick, children[0], turns, text)
    branch = branch_of(code & STATUS_BITS, len(children))
    if branch:
        child = children[branch]
        for guard in tick.layout.fresh[child]:
            turns += tick.turned[guard]
        code = code & ACTED | ticks[child](tick, child, turns, text)
    tick.stops[node] = branch
    tick.statuses[node] = code & STATUS_BITS
    tick.acted[node] = code > STATUS_BITS
    return code


def _parallel(tick: Tick, node: int, turns: int, text: str) -> int:
    ticks, children = tick.functions.ticks, tick.layout.children[node]
    successes = failures = acting = 0
    for child in children:
        code = ticks[child](tick, child, turns, text)
        if code > STATUS_BITS:
            acting += 1
            code &= STATUS_BITS
        if code == SUCCESS:
            successes += 1
        elif code == FAILURE:
            failures += 1
    tick.successes[node], tick.failures[node], tick.acting[node] = successes, failures, acting
    tick.statuses[node] = status = tick.parallel(node)
    if status != RUNNING and successes + failures < len(children):
        tick.hides = True
    if acting:
        tick.acted[node] = 1
        return status | ACTED
    return status


def _unary(tick: Tick, node: int, turns: int, text: str) -> int:
    child = tick.layout.children[node][0]
    code = tick.functions.ticks[child](tick, child, turns, text)
    status = tick.functions.unary[node][code & STATUS_BITS]
    tick.statuses[node] = status
    tick.acted[node] = code > STATUS_BITS
    return status | code & ACTED


def _timeout(tick: Tick, node: int, turns: int, text: str) -> int:
    tick.names[node] = tick.name(node, turns, text)
    child = tick.layout.children[node][0]
    code = tick.functions.ticks[child](tick, child, turns, text)
    if code & STATUS_BITS == RUNNING:
        if tick.facts.has_expired(tick.names[node]):
            tick.hides = True
            code = FAILURE | ACTED
        else:
            tick.watching.append(tick.layout.ranks[node])
    tick.statuses[node] = code & STATUS_BITS
    tick.acted[node] = code > STATUS_BITS
    return code


def _loop(tick: Tick, node: int, turns: int, text: str) -> int:
    tick.names[node] = tick.name(node, turns, text)
    code = tick.round(node, turns, text)
    tick.statuses[node] = code & STATUS_BITS
    tick.acted[node] = code > STATUS_BITS
    return code


def _remembering(tick: Tick, node: int, turns: int, text: str) -> int:
    """A control that does not look again at children that have ended."""
    tick.names[node] = tick.name(node, turns, memory_text(tick.layout, node, text))
    code = tick.functions.plain[node](tick, node, turns, text)
    tick.report(node)
    return code


def _recalled(tick: Tick, node: int, turns: int, text: str) -> int:
    """A child of such a node."""
    parent, position = tick.layout.parents[node], tick.layout.positions[node]
    before = tick.facts.child_result(tick.names[parent], position)
    if before is not None:
        tick.skipped[node] = 1
        tick.statuses[node] = before
        # What an earlier attempt has done uses up no further one.
        tick.acted[node] = not tick.layout.keeps(parent)
        return before | ACTED if tick.acted[node] else int(before)
    code = tick.functions.inner[node](tick, node, turns, text)
    status = code & STATUS_BITS
    if status != RUNNING:
        tick.ended.setdefault(parent, {})[position] = status == SUCCESS
    return code


_FUNCTIONS: Mapping[Kind, Function] = {
    Kind.CONDITION: _condition,
    Kind.ACTION: _action,
    Kind.SEQUENCE: _in_order,
    Kind.FALLBACK: _in_order,
    Kind.PARALLEL: _parallel,
    Kind.IF_THEN_ELSE: _if_then_else,
    Kind.TIMEOUT: _timeout,
    **dict.fromkeys(UNARY, _unary),
    **dict.fromkeys((Kind.RETRY, Kind.REPEAT, Kind.KEEP_RUNNING_UNTIL_FAILURE), _loop),
}
