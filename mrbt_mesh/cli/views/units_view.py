"""How a tree was split into units, for people and as data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from mrbt_mesh.analysis.lift_units import LiftedUnits
from mrbt_mesh.analysis.unit_tasks import UnitUse


def units_data(found: LiftedUnits) -> dict[str, Any]:
    """What `mrbt lift --units --json` prints besides; the keys are documented in docs/lift.md."""
    return {
        "units": [_unit_data(use) for use in found.tasks.uses],
        "cuts": [
            {"path": path, "first": first, "second": second, "reason": reason}
            for path, first, second, reason in _cuts(found)
        ],
    }


def _unit_data(use: UnitUse) -> dict[str, Any]:
    return {
        "call": use.call,
        "tree": use.task.tree,
        "nodes": [node.path for node in use.piece.nodes],
        "line": use.piece.nodes[0].line,
        "reasons": list(use.piece.reasons),
    }


def _cuts(found: LiftedUnits) -> Iterator[tuple[str, str, str, str]]:
    for piece in found.split.walk():
        for first, second, reason in piece.cuts:
            yield piece.nodes[0].path, first, second, reason


def render_units(found: LiftedUnits) -> RenderableType:
    """Every unit with why it stays together, and every cut with why it can be made."""
    count = len(found.tasks.uses)
    units = f"{count} units, each" if count != 1 else "1 unit,"
    lines = [Text(f"{units} carried out by one robot with a blackboard of its own:", "bold")]
    for use in found.tasks.uses:
        (first, *_) = use.piece.nodes
        names = f"  {first.path}:{first.line}"
        lines.append(Text.assemble(("■", "bold cyan"), " ", (use.call, "bold"), (names, "dim")))
        if len(use.piece.nodes) > 1:
            inside = ", ".join(node.name for node in use.piece.nodes)
            lines.append(Text(f"      {inside}"))
        lines += [Text(f"      together: {reason}", "dim") for reason in use.piece.reasons]
    cuts = list(_cuts(found))
    if cuts:
        lines += [Text(), Text("Cut apart, for different robots:", "bold")]
    for path, first_name, second_name, reason in cuts:
        pair = f"{first_name} | {second_name}"
        lines.append(Text.assemble(("✂", "green"), " ", pair, (f"  {path}: {reason}", "dim")))
    lines += [Text(), Text("Between them:", "bold")]
    return Group(*lines)
