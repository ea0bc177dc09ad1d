"""docs/bring-your-robot.md: its commands run, one after the other, in a new folder."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.command import mrbt
from tests.support.paths import EXAMPLES, ROOT

PAGE = (ROOT / "docs" / "bring-your-robot.md").read_text()
SECTIONS = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL))
# With teams of real processes: tests/processes/test_bring_your_robot.py.
REAL = ("up", "kill")


def commands(section: str) -> list[list[str]]:
    """The words of a section's commands."""
    return [
        shlex.split(line) for line in re.findall(r"^    (\w.*)$", SECTIONS[section], re.MULTILINE)
    ]


@pytest.mark.parametrize("section", [name for name in SECTIONS if commands(name)])
def test_what_it_says_can_be_done(
    section: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    for program, *words in commands(section):
        if program == "pytest":
            plugins = ("-p", "mrbt_mesh.pytest_plugin", "-p", "no:cacheprovider")
            done = subprocess.run(
                [sys.executable, "-m", "pytest", "-q", *plugins, *words], check=False
            )
            assert done.returncode == 0
        elif words[0] not in REAL:
            assert program == "mrbt"
            code, output, problems = mrbt(*words, *(["--json"] if words[0] == "sim" else []))
            assert code == 0, (words, output, problems)
            if "--kill" in words:
                summary = json.loads(output)
                victim = words[words.index("--kill") + 1].partition("@")[0]
                assert [takeover["robot"] for takeover in summary["takeovers"]] == [victim]


def test_every_way_of_its_table_is_there() -> None:
    wanted = {"a-driver-in-python", "a-tree-of-one-robot", "action-servers-of-ros-2"}
    wanted.add("a-fleet-of-vda-5050")
    told = {name.lower().replace(" ", "-") for name in SECTIONS}
    assert set(re.findall(r"\(#([\w-]+)\)", PAGE)) == wanted
    assert wanted < told
