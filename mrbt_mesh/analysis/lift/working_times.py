"""How long a tree's actions take, one after the other and side by side."""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.bt.tree import Kind, NodeSpec


def serial_work(spec: NodeSpec, work: Mapping[str, int]) -> int:
    """What all actions below take one after the other, if each is done once and well."""
    return _work(spec, work, is_serial=True)


def critical_work(spec: NodeSpec, work: Mapping[str, int]) -> int:
    """The longest chain of actions below."""
    return _work(spec, work, is_serial=False)


def _work(spec: NodeSpec, work: Mapping[str, int], is_serial: bool) -> int:
    """If nothing fails: of a Fallback the first that acts, of a Parallel the M soonest done."""
    if spec.kind is Kind.ACTION:
        return work.get(spec.subject, 1_000_000)
    parts = [_work(child, work, is_serial) for child in spec.children]
    match spec.kind:
        case Kind.FALLBACK:
            children = zip(parts, spec.children, strict=True)
            return next((part for part, child in children if child.contains(Kind.ACTION)), 0)
        case Kind.PARALLEL:
            needed = sorted(parts)[: spec.limit]
            return sum(needed) if is_serial else max(needed)
        case Kind.IF_THEN_ELSE:
            return parts[0] + max(parts[1:])
        case Kind.REPEAT:
            return sum(parts) * max(1, spec.limit)
    return sum(parts)
