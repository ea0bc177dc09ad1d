"""What was decided when a tree was lifted, for people and as data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from mrbt_mesh.analysis.lift.lifter import LiftDecision, Lifted
from mrbt_mesh.analysis.lift.mission import LiftedMission


def lifted_data(found: LiftedMission, output: Path | None) -> dict[str, Any]:
    """What `mrbt tree lift --json` prints; the keys are documented in docs/how-to/lift.md."""
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


def render_lifted(lifted: Lifted) -> RenderableType:
    """Every decision with its reasons, and what is gained at most."""
    lines = [line for decision in lifted.decisions for line in _decision(decision)]
    serial_s, critical_s = lifted.serial_us / 1e6, lifted.critical_us / 1e6
    gain = Text.assemble(
        f"One robot works {serial_s:g} s; the longest chain is {critical_s:g} s: at most ",
        (f"{lifted.factor:.2f}", "bold"),
        " times faster.",
    )
    return Group(*lines, Text(), gain)


def _decision(decision: LiftDecision) -> list[Text]:
    mark = ("∥", "bold green") if decision.is_parallel else ("→", "dim")
    lines = [
        Text.assemble(mark, " ", (decision.path, "bold"), (f"  {decision.kind}", "dim")),
        Text(f"    {decision.after}", "green" if decision.is_parallel else ""),
    ]
    for dependence in decision.dependences:
        style = "yellow" if dependence.is_added else "dim"
        pair = f"{dependence.first} before {dependence.second}: {dependence.reason}"
        lines.append(Text(f"      {pair}", style))
    lines += [Text(f"      {note}", "yellow") for note in decision.notes]
    return lines
