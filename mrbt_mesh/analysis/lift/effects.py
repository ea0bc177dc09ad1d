"""What actions and conditions read, write and need, and what a whole subtree does of that.

A subtree is worked through with what is known before it: which conditions hold for certain. An
action succeeds where what it requires is known to hold, unless it declares that it may fail all the
same; a condition that is asked may always turn out either way, since the world may change it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.formats.declaration import Declaration

# An action's name -> what it declares; an action that is not in it declares nothing.
Declarations: TypeAlias = Mapping[str, Declaration]


@dataclass(frozen=True, slots=True)
class EffectSummary:
    """What a subtree does. `undeclared` are actions without declarations; they may do anything."""

    reads: frozenset[str] = frozenset()
    writes: frozenset[str] = frozenset()
    uses: frozenset[str] = frozenset()
    undeclared: tuple[str, ...] = ()

    def __or__(self, other: EffectSummary) -> EffectSummary:
        return EffectSummary(
            self.reads | other.reads,
            self.writes | other.writes,
            self.uses | other.uses,
            self.undeclared + tuple(x for x in other.undeclared if x not in self.undeclared),
        )


def summary(spec: NodeSpec, declared: Declarations) -> EffectSummary:
    """What the subtree reads, writes and uses."""
    if spec.kind is Kind.CONDITION:
        return EffectSummary(reads=frozenset({spec.subject}))
    if spec.kind is Kind.ACTION:
        known = declared.get(spec.subject)
        if known is None:
            return EffectSummary(undeclared=(spec.subject,))
        return EffectSummary(known.all_reads, known.all_writes, known.uses)
    found = EffectSummary()
    for child in spec.children:
        found |= summary(child, declared)
    return found


# Conditions that are known, None where the status in question cannot come up.
Known: TypeAlias = Mapping[str, bool]


@dataclass(frozen=True, slots=True)
class Ends:
    """What is known once a subtree has succeeded, and once it has failed; None: it cannot."""

    success: Known | None
    failure: Known | None

    @property
    def may_fail(self) -> bool:
        return self.failure is not None


def _either(one: Known | None, other: Known | None) -> Known | None:
    if one is None or other is None:
        return one if other is None else other
    return {name: value for name, value in one.items() if other.get(name) is value}


def without(known: Known, names: frozenset[str]) -> Known:
    """What is still known after these may have changed."""
    return {name: value for name, value in known.items() if name not in names}


def ends(spec: NodeSpec, known: Known, declared: Declarations) -> Ends:
    """How the subtree can end if `known` holds before it."""
    match spec.kind:
        case Kind.CONDITION:
            return Ends({**known, spec.subject: True}, {**known, spec.subject: False})
        case Kind.ACTION:
            return _action_ends(declared.get(spec.subject), known)
        case Kind.SEQUENCE:
            return _forget_if_guarded(spec, _in_order(spec, known, declared), declared)
        case Kind.FALLBACK:
            return _forget_if_guarded(spec, _inverted(_in_order(spec, known, declared)), declared)
        case Kind.INVERTER:
            return _inverted(ends(spec.children[0], known, declared))
        case Kind.SUBTREE:
            return ends(spec.children[0], known, declared)
        case Kind.FORCE_SUCCESS:
            found = ends(spec.children[0], known, declared)
            return Ends(_either(found.success, found.failure), None)
        case Kind.FORCE_FAILURE:
            found = ends(spec.children[0], known, declared)
            return Ends(None, _either(found.success, found.failure))
        case Kind.IF_THEN_ELSE:
            return _branches(spec, known, declared)
    return _whatever(spec, known, declared)


def _action_ends(action: Declaration | None, known: Known) -> Ends:
    if action is None:
        return Ends({}, {})
    asked = [known.get(name) is value for name, value in action.requires.items()]
    ruled_out = any(known.get(name) is (not value) for name, value in action.requires.items())
    after = {**without(known, action.writes), **action.requires, **action.effects}
    certain = all(asked) and not action.may_fail
    failed = without(known, action.writes)
    return Ends(None if ruled_out else after, None if certain else failed)


def _in_order(spec: NodeSpec, known: Known, declared: Declarations) -> Ends:
    """A Sequence; for a Fallback with the statuses the other way round."""
    passed: Known | None = known
    stopped: Known | None = None
    for child in spec.children:
        if passed is None:
            break
        found = ends(child, passed, declared)
        if spec.kind is Kind.FALLBACK:
            found = _inverted(found)
        passed, stopped = found.success, _either(stopped, found.failure)
    return Ends(passed, stopped)


def _inverted(found: Ends) -> Ends:
    return Ends(found.failure, found.success)


def _branches(spec: NodeSpec, known: Known, declared: Declarations) -> Ends:
    condition = ends(spec.children[0], known, declared)
    found = Ends(None, condition.failure if len(spec.children) == 2 else None)
    for before, branch in zip(
        (condition.success, condition.failure), spec.children[1:], strict=False
    ):
        if before is not None:
            after = ends(branch, before, declared)
            found = Ends(
                _either(found.success, after.success), _either(found.failure, after.failure)
            )
    return _forget_if_guarded(spec, found, declared)


def _forget_if_guarded(spec: NodeSpec, found: Ends, declared: Declarations) -> Ends:
    """A reactive node may be stopped halfway by what is done below it."""
    if not guards(spec) & summary(spec, declared).writes:
        return found
    return _whatever(spec, {}, declared)


def _whatever(spec: NodeSpec, known: Known, declared: Declarations) -> Ends:
    """Of a Parallel, a Retry or a Timeout no more is known than what nothing below can change."""
    found = summary(spec, declared)
    kept = {} if found.undeclared else without(known, found.writes)
    if spec.kind is Kind.TIMEOUT or spec.kind is Kind.KEEP_RUNNING_UNTIL_FAILURE:
        return Ends(kept, kept)
    certain = not any(ends(child, kept, declared).may_fail for child in spec.children)
    is_guarded = bool(guards(spec) & found.writes)
    return Ends(kept, None if certain and not is_guarded else kept)


def guards(spec: NodeSpec) -> frozenset[str]:
    """The conditions that a reactive node asks again at every tick, for its later children."""
    if spec.memory is not Memory.NONE or spec.kind not in (
        Kind.SEQUENCE,
        Kind.FALLBACK,
        Kind.IF_THEN_ELSE,
    ):
        return frozenset()
    asking = spec.children[:1] if spec.kind is Kind.IF_THEN_ELSE else spec.children[:-1]
    return frozenset().union(*(conditions(child) for child in asking))


def conditions(spec: NodeSpec) -> frozenset[str]:
    """All conditions that are asked below a node."""
    if spec.kind is Kind.CONDITION:
        return frozenset({spec.subject})
    return frozenset().union(*map(conditions, spec.children))
