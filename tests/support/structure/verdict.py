"""A check's findings against those that are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tests.support.structure.known import KNOWN
from tests.support.structure.source import Finding


def unsettled(
    check: str,
    findings: Sequence[Finding],
    known: Mapping[str, frozenset[str]] = KNOWN,
) -> str:
    """What is new, and what is listed as known and is no more; nothing: empty."""
    listed = known.get(check, frozenset())
    new = [str(finding) for finding in findings if finding.key not in listed]
    mended = sorted(listed - {finding.key for finding in findings})
    gone = [f"{key}: mended; take it out of KNOWN[{check!r}]" for key in mended]
    return "\n".join([*new, *gone])
