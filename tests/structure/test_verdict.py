"""Known violations are told from new ones, and from those that are gone."""

from __future__ import annotations

import pytest

from tests.support.structure.source import Finding
from tests.support.structure.verdict import known, settle, unsettled

OLD, NEW = Finding("a.py", "500 lines"), Finding("b.py", "600 lines")


@pytest.mark.parametrize(
    ("findings", "said"),
    [
        ([OLD], []),
        ([OLD, NEW], ["b.py: 600 lines"]),
        ([], ["a.py: mended; take its line out of known.txt"]),
    ],
)
def test_only_what_is_new_or_gone_is_said(findings: list[Finding], said: list[str]) -> None:
    assert unsettled("files", findings, {"files": {"a.py"}}) == said
    assert unsettled("others", findings, {}) == [str(finding) for finding in findings]


def test_a_finding_fails_the_test_with_a_line_that_says_what() -> None:
    with pytest.raises(pytest.fail.Exception, match=r"^nothing:\na.py: 500 lines$"):
        settle("nothing", [OLD])
    settle("nothing", [])


def test_what_is_known_stands_in_a_file() -> None:
    text = "# To be mended.\n\nfiles | a.py\ncircles | a imports b imports a\nfiles | b.py\n"
    assert known(text) == {"files": {"a.py", "b.py"}, "circles": {"a imports b imports a"}}
