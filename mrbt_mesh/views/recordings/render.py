"""Renders the results of `mrbt recording verify` and `what-if` for a terminal."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from mrbt_mesh.cli.printing import Printable, Stack, Styled
from mrbt_mesh.cli.terminal import table
from mrbt_mesh.core.facts.values import printable
from mrbt_mesh.views.replay.findings import ON_TRUST, Verification

# How many findings are printed; `--json` has all.
MOST_FINDINGS = 20
_TASK_STATES = ("success", "failure", "running", "cancelled", "not_started")
_COUNTED = {
    "facts": "facts read again",
    "signatures": "signatures of facts checked",
    "recording_signatures": "signatures of recordings checked",
    "heads": "times a robot heard how far another one had recorded",
    "dropped": "facts dropped rightly",
    "plans": "plans made again",
    "statuses": "statuses of T_G found again",
    "lines": "times a robot followed its plan",
    "claims": "claims as planned",
    "actions": "actions as planned",
}


def render_verdict(verdict: Verification, accepted: Collection[str]) -> Printable:
    """Return counts, takeovers with their causes, what is proved, what is not, and by which key."""
    counts = table("", "", right=(0,))
    for name, text in _COUNTED.items():
        if name in verdict.counts:
            counts.add_row(str(verdict.counts[name]), text)
    parts: list[Printable] = [_basis(verdict), counts]
    if verdict.is_running:
        text = (
            "the team runs: this is of what it has recorded until now, and its end is not here yet"
        )
        parts.insert(0, Styled(text, "bold yellow"))
    for each in verdict.takeovers:
        text = f"{each.at_us / 1e6:.3f} s: {each.robot} took over {each.local_task} of {each.of}"
        parts.append(_line(f"{text}: {each.cause}"))
    parts += [_line(f"proved: {each}", "green") for each in verdict.proved]
    for gap in verdict.gaps:
        word = "accepted" if gap.kind in accepted else "not proved"
        parts.append(_line(f"{word}: {gap}", "yellow"))
    parts += [_line(f"note: {each}", "yellow") for each in verdict.notes]
    if verdict.no_evidence:
        listed = ", ".join(verdict.no_evidence)
        parts.append(_line(f"no evidence, as nothing signs them: {listed}", "dim"))
    parts += [_line(str(finding), "red") for finding in verdict.findings[:MOST_FINDINGS]]
    more = len(verdict.findings) - MOST_FINDINGS
    if more > 0:
        parts.append(Styled(f"and {more} more: --json has all", "red"))
    files = f"{len(verdict.files)} recordings"
    if verdict.is_proved:
        last = Styled(f"proved: what the team did, by {files}; {ON_TRUST}", "bold green")
    elif verdict.holds(accepted):
        last = Styled(f"{files} agree; what was accepted above is not proved", "bold")
    else:
        gaps = sum(gap.kind not in accepted for gap in verdict.gaps)
        counted = f"{len(verdict.findings)} contradictions, {gaps} gaps"
        last = Styled(f"not proved: {counted} in {files}", "bold red")
    return Stack(*parts, last)


def _line(text: str, style: str = "") -> Styled:
    """Return one line, whatever the names of files, which others have chosen, contain."""
    return Styled(printable(text), style)


def _basis(verdict: Verification) -> Styled:
    """Return what all signatures depend on."""
    if not verdict.team_key:
        return Styled("Without keys everything can be forged: this proves nothing.", "bold yellow")
    compare = "compare it with your own: `mrbt keys show`"
    return Styled(f"signed by the team whose key is {verdict.team_key[:16]}: {compare}")


def render_what_if(data: Mapping[str, Any]) -> Printable:
    """Return the recorded run beside its simulated continuation, and the assumptions."""
    rows = table("", "what happened", "what if")
    both = (data["recorded"], data["what_if"])
    rows.add_row("result", *(Styled(row["result"], "bold") for row in both))
    rows.add_row("over", *(_time(row["over_at_s"]) for row in both))
    for state in _TASK_STATES:
        counts = [
            sum(task["status"] == state for task in row["global_tasks"].values()) for row in both
        ]
        if any(counts):
            rows.add_row(f"tasks: {state}", *map(str, counts))
    rows.add_row("blocked", *("; ".join(_blocked(row)) or "nothing" for row in both))
    faults = ", ".join(data["faults"]) or "no other fault"
    if data["without_recorded_faults"]:
        faults += ", without the recorded ones"
    under_way = ", ".join(f"{robot}: {task}" for robot, task in data["under_way"].items())
    return Stack(
        Styled(f"from {data['at_s']:g} s on: {faults}", "bold"),
        Styled(f"under way then: {under_way or 'nothing'}"),
        rows,
        *(Styled(f"assumed: {text}", "dim") for text in data["assumed"]),
    )


def _time(seconds: float | None) -> str:
    return "not" if seconds is None else f"at {seconds:.2f} s"


def _blocked(summary: Mapping[str, Any]) -> list[str]:
    """Return requests that were blocked at the end."""
    return [f"{row['request']} {row['reason']}" for row in summary["blocked"] if row["to"] is None]
