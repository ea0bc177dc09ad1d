"""The decisions of lifting a tree, for people and as data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.analysis.lift.in_units import LiftedUnits
from mrbt_mesh.analysis.lift.lifter import LiftDecision, Lifted
from mrbt_mesh.analysis.lift.mission import LiftedMission
from mrbt_mesh.analysis.lift.unit_tasks import UnitUse
from mrbt_mesh.analysis.lift.units import Piece
from mrbt_mesh.cli.printing import Printable, Stack, Styled


def lifted_data(found: LiftedMission, output: Path | None) -> dict[str, Any]:
    """The output of `mrbt tree lift --json`; its keys are documented in docs/how-to/lift.md."""
    lifted = found.lifted
    return {
        "mission": str(output) if output is not None else None,
        "serial_s": lifted.serial_us / 1e6,
        "critical_path_s": lifted.critical_us / 1e6,
        "factor": round(lifted.factor, 3),
        "decisions": [_decision_data(decision) for decision in lifted.decisions],
        "notes": [str(note) for note in found.notes],
    }


def _decision_data(decision: LiftDecision) -> dict[str, Any]:
    return {
        "path": decision.path,
        "kind": decision.kind,
        "children": list(decision.before),
        "arrangement": decision.after,
        "parallel": decision.is_parallel,
        "dependences": [
            {"first": d.first, "second": d.second, "reason": d.reason, "added": d.is_added}
            for d in decision.dependences
        ],
        "notes": list(decision.notes),
    }


def render_lifted(lifted: Lifted) -> Printable:
    """Every decision with its reasons, and the largest possible gain."""
    lines = [line for decision in lifted.decisions for line in _decision(decision)]
    serial_s, critical_s = lifted.serial_us / 1e6, lifted.critical_us / 1e6
    gain = Styled.assemble(
        f"One robot works {serial_s:g} s; the longest chain is {critical_s:g} s: at most ",
        (f"{lifted.factor:.2f}", "bold"),
        " times faster.",
    )
    return Stack(*lines, Styled(), gain)


def _decision(decision: LiftDecision) -> list[Styled]:
    mark = ("∥", "bold green") if decision.is_parallel else ("→", "dim")
    lines = [
        Styled.assemble(mark, " ", (decision.path, "bold"), (f"  {decision.kind}", "dim")),
        Styled(f"    {decision.after}", "green" if decision.is_parallel else ""),
    ]
    for dependence in decision.dependences:
        style = "yellow" if dependence.is_added else "dim"
        pair = f"{dependence.first} before {dependence.second}: {dependence.reason}"
        lines.append(Styled(f"      {pair}", style))
    lines += [Styled(f"      {note}", "yellow") for note in decision.notes]
    return lines


def units_data(found: LiftedUnits) -> dict[str, Any]:
    """The additions of `--units --json`; their keys are documented in docs/how-to/lift.md."""
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


def render_units(found: LiftedUnits) -> Printable:
    """Every unit with why it stays together, and every cut with why it can be made."""
    count = len(found.tasks.uses)
    units = f"{count} units, each" if count != 1 else "1 unit,"
    lines = [Styled(f"{units} carried out by one robot with a blackboard of its own:", "bold")]
    for use in found.tasks.uses:
        (first, *_) = use.piece.nodes
        names = f"  {first.path}:{first.line}"
        lines.append(Styled.assemble(("■", "bold cyan"), " ", (use.call, "bold"), (names, "dim")))
        if len(use.piece.nodes) > 1:
            inside = ", ".join(node.name for node in use.piece.nodes)
            lines.append(Styled(f"      {inside}"))
        lines += [Styled(f"      together: {reason}", "dim") for reason in use.piece.reasons]
    calls = {id(use.piece): use.call for use in found.tasks.uses}
    cuts = [line for piece in found.split.walk() for line in _cut_lines(piece, calls)]
    if cuts:
        lines += [Styled(), Styled("Cut apart, for different robots:", "bold"), *cuts]
    if found.mission.lifted.decisions:
        lines += [Styled(), Styled("Between them:", "bold")]
    return Stack(*lines)


def _cut_lines(piece: Piece, calls: Mapping[int, str]) -> Iterator[Styled]:
    """The children of one node, with each reason once."""
    path = piece.nodes[0].path
    names = [calls.get(id(child), child.label) for child in piece.children]
    reasons = [reason for _, _, reason in piece.cuts]
    for reason in dict.fromkeys(reasons):
        runs = [[names[0]]]
        for name, own in zip(names[1:], reasons, strict=True):
            if own == reason:
                runs[-1].append(name)
            else:
                runs.append([name])
        for run in runs:
            if len(run) > 1:
                pair = " | ".join(run)
                yield Styled.assemble(("✂", "green"), " ", pair, (f"  {path}: {reason}", "dim"))
