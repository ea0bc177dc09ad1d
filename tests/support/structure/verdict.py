"""A check's findings against those that are known."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import pytest

from tests.support.structure.source import Finding

# A line for each: the check, ` | `, the key of the finding.
FILE = Path(__file__).with_name("known.txt")


def settle(check: str, findings: Sequence[Finding]) -> None:
    """Fail the test, with a line each, for findings that are new or known ones that are gone."""
    lines = unsettled(check, findings, known(FILE.read_text(encoding="utf-8")))
    if lines:
        pytest.fail("\n".join([f"{check}:", *lines]), pytrace=False)


def known(text: str) -> Mapping[str, Collection[str]]:
    """The keys of the known findings, by check; lines that begin with # are remarks."""
    found: dict[str, set[str]] = defaultdict(set)
    for line in text.splitlines():
        if line and not line.startswith("#"):
            check, _, key = line.partition(" | ")
            found[check].add(key)
    return found


def unsettled(
    check: str, findings: Sequence[Finding], known: Mapping[str, Collection[str]]
) -> list[str]:
    """What is new, and what is listed as known and is no more, as lines."""
    listed = set(known.get(check, ()))
    new = [str(finding) for finding in findings if finding.key not in listed]
    mended = sorted(listed - {finding.key for finding in findings})
    return [*new, *(f"{key}: mended; take its line out of {FILE.name}" for key in mended)]
