"""Differences between a team and BehaviorTree.CPP at nodes that a team can carry out."""

from __future__ import annotations

from collections.abc import Iterator

from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec

_REACTIVE_KINDS = frozenset({Kind.SEQUENCE, Kind.FALLBACK, Kind.IF_THEN_ELSE})
_LOOPS = frozenset({Kind.RETRY, Kind.REPEAT, Kind.KEEP_RUNNING_UNTIL_FAILURE})
_YIELDING = frozenset({"AsyncSequence", "AsyncFallback"})


def notes(type_name: str, spec: NodeSpec, yields: bool) -> Iterator[str]:
    """Yield the differences at one node with this type in the file.

    `yields`: whether one of its guards, as written in the file, returns RUNNING between its steps.
    """
    is_reactive = spec.memory is Memory.NONE and spec.kind in _REACTIVE_KINDS
    if is_reactive and spec.kind is Kind.IF_THEN_ELSE:
        # The library keeps the result of an action that is itself the condition, as a team does.
        if spec.children[0].contains(Kind.ACTION) and spec.children[0].kind is not Kind.ACTION:
            yield (
                "an action inside its condition is begun again by BehaviorTree.CPP whenever the "
                "condition has been decided, and as long as it runs nothing else is ticked; a team "
                "does it once, and goes on"
            )
    elif is_reactive and any(child.contains(Kind.ACTION) for child in spec.children[:-1]):
        yield (
            "an action before its last child is begun again at every tick by BehaviorTree.CPP; "
            "a team does it once"
        )
    if is_reactive and yields:
        yield (
            "between two attempts of a Repeat or Retry, and between two children of an Async node, "
            "BehaviorTree.CPP halts the later children; a team decides such a guard at once"
        )
    if spec.kind is Kind.IF_THEN_ELSE and type_name == "IfThenElse" and len(spec.children) == 2:
        yield (
            "without a third child BehaviorTree.CPP does not ask its first child again once that "
            "has failed; a team does"
        )
    if _waits_for_conditions(spec):
        yield (
            "over conditions alone it waits; a team reads them, and whatever else decides with "
            "them, again at every change"
        )
    if spec.kind is Kind.PARALLEL and _may_decide_at_once(spec):
        yield (
            "where conditions decide it at once, BehaviorTree.CPP starts the actions left of them "
            "all the same; a team does not"
        )


def returns_between_steps(type_name: str, spec: NodeSpec) -> bool:
    """True if BehaviorTree.CPP lets a tick pass between two steps of this node."""
    if spec.kind in (Kind.RETRY, Kind.REPEAT):
        return spec.limit != 1
    return type_name in _YIELDING and len(spec.children) > 1


def _waits_for_conditions(spec: NodeSpec) -> bool:
    if spec.kind not in _LOOPS or spec.contains(Kind.ACTION):
        return False
    return spec.kind is Kind.KEEP_RUNNING_UNTIL_FAILURE or spec.limit < 0


def _may_decide_at_once(spec: NodeSpec) -> bool:
    flags = [child.contains(Kind.ACTION) for child in spec.children]
    return any(flags) and not all(flags[flags.index(True) :])
