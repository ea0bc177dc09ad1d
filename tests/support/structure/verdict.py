"""A check's findings against those that are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from tests.support.structure.known import KNOWN
from tests.support.structure.source import Finding


def settle(check: str, findings: Sequence[Finding]) -> None:
    """Fail the test, with a line each, for findings that are new or known ones that are gone."""
    lines = unsettled(check, findings, KNOWN)
    if lines:
        pytest.fail("\n".join([f"{check}:", *lines]), pytrace=False)


def unsettled(
    check: str, findings: Sequence[Finding], known: Mapping[str, frozenset[str]]
) -> list[str]:
    """What is new, and what is listed as known and is no more, as lines."""
    listed = known.get(check, frozenset())
    new = [str(finding) for finding in findings if finding.key not in listed]
    mended = sorted(listed - {finding.key for finding in findings})
    return [*new, *(f"{key}: mended; take it out of KNOWN[{check!r}]" for key in mended)]
