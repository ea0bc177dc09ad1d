"""What is wrong with a tree file, in one line each; brackets of names mean nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.text import Text

from mrbt_mesh.btcpp.files.findings import Finding, Findings, Severity
from mrbt_mesh.errors import Problem


def line(first: str, style: str, rest: str) -> Text:
    """A line whose beginning is in a style."""
    return Text.assemble((first, style), f" {rest}")


def finding_line(finding: Finding) -> Text:
    """An error or a warning."""
    style = "bold red" if finding.severity is Severity.ERROR else "yellow"
    return line(f"{finding.severity}:", style, str(finding))


def check_lines(
    findings: Findings, refusals: Sequence[Problem], notes: Sequence[Problem]
) -> Iterator[Text]:
    """All that was found in a file."""
    for finding in findings.in_order():
        yield finding_line(finding)
    if findings.is_full:
        yield line("error:", "bold red", "and more")
    for problem in refusals:
        yield line("not for a team:", "bold red", str(problem))
    for problem in notes:
        yield line("note:", "cyan", str(problem))
