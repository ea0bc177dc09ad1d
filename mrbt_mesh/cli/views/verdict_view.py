"""What `mrbt recording verify` has found, for a terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from mrbt_mesh.views.replay.findings import Verification

# So many findings are told; `--json` has all.
MOST_FINDINGS = 20
_COUNTED = {
    "facts": "facts read again",
    "signatures": "signatures checked",
    "dropped": "facts dropped rightly",
    "plans": "plans made again",
    "statuses": "statuses of T_G found again",
    "lines": "times a robot followed its plan",
    "claims": "claims as planned",
    "actions": "actions as planned",
}


def render_verdict(verdict: Verification) -> RenderableType:
    """Counts, takeovers with their causes, and what is wrong."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(justify="right")
    table.add_column()
    for name, text in _COUNTED.items():
        if name in verdict.counts:
            table.add_row(str(verdict.counts[name]), text)
    parts: list[RenderableType] = [table]
    for each in verdict.takeovers:
        text = f"{each.at_us / 1e6:.3f} s: {each.robot} took over {each.local_task} of {each.of}"
        parts.append(Text(f"{text}: {each.cause}"))
    parts += [Text(f"note: {note}", "yellow") for note in verdict.notes]
    parts += [Text(str(finding), "red") for finding in verdict.findings[:MOST_FINDINGS]]
    more = len(verdict.findings) - MOST_FINDINGS
    if more > 0:
        parts.append(Text(f"and {more} more: --json has all", "red"))
    files = f"{len(verdict.files)} recordings"
    if verdict.is_good:
        parts.append(Text(f"verified: {files} prove what the team did", "bold green"))
    else:
        parts.append(Text(f"not verified: {len(verdict.findings)} findings in {files}", "bold red"))
    return Group(*parts)
