"""The commands of the guides run, one after the other, in a new folder."""

from __future__ import annotations

import json
import re
import shlex
import sys
from pathlib import Path

import pytest

from tests.support.command import mrbt
from tests.support.paths import EXAMPLES, ROOT

# With teams of real processes: tests/processes/test_new_teams.py.
REAL = ("up", "kill")


def commands(page: str, section: str) -> list[list[str]]:
    """The words of the commands in one section of a page."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    body = text.partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    return [shlex.split(line, comments=True) for line in re.findall(r"^    (mrbt .*)$", body, re.M)]


@pytest.mark.parametrize(
    ("page", "section"),
    [
        ("tutorial/your-robot.md", "Run a small team"),
        ("tutorial/your-robot.md", "Other kinds of robots"),
        ("how-to/lift.md", "Try it with a tree of Nav2"),
    ],
)
def test_the_commands_of_a_section_succeed(
    page: str, section: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    found = commands(page, section)
    assert found
    for _, *words in found:
        if words[0] in REAL:
            continue
        is_run = words[:2] == ["sim", "run"]
        code, output, problems = mrbt(*words, *(["--json"] if is_run else []))
        assert code == 0, (words, output, problems)
        if "--kill" in words:
            victim = words[words.index("--kill") + 1].partition("@")[0]
            takeovers = json.loads(output)["takeovers"]
            assert [takeover["robot"] for takeover in takeovers] == [victim]
