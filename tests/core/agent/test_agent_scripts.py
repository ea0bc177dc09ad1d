"""Conversations of agents: golden files in `scripts/`, of features too, to be read like a story.

With MRBT_REWRITE=1 the files are written anew. Commit a changed golden only when you can say
why it changed.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mrbt_mesh.core.engine import DEFINITIONS, Engine
from mrbt_mesh.core.feature import NAMES
from tests.support.mutations import MUTATIONS
from tests.support.paths import ROOT
from tests.support.script import Script

FOLDER = Path(__file__).parent / "scripts"
FOLDERS = [FOLDER, *(ROOT / "tests" / "features" / name / "scripts" for name in NAMES)]
SCRIPTS = sorted(path for folder in FOLDERS for path in folder.glob("*.txt"))


def replayed(text: str, engine: Engine | None = None) -> str:
    """The script with the output of every block as it is now."""
    script = Script(engine)
    parts = []
    for block in text.strip().split("\n\n"):
        commands = block.partition("\n----")[0].splitlines()
        if not all(line.startswith("#") for line in commands):
            block = "\n".join([*commands, "----", script.block(commands)])
        parts.append(block)
    return "\n\n".join(parts) + "\n"


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_the_conversation_goes_as_written(path: Path) -> None:
    written = path.read_text()
    found = replayed(written)
    if os.environ.get("MRBT_REWRITE"):
        path.write_text(found)
    assert found.splitlines() == written.splitlines()


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_the_conversation_is_the_same_by_the_definitions(path: Path) -> None:
    written = path.read_text()
    assert replayed(written, DEFINITIONS).splitlines() == written.splitlines()


def test_a_robot_that_begins_alone_at_once_is_noticed() -> None:
    """It would do what others do that it does not hear."""
    written = (FOLDER / "alone.txt").read_text()
    with MUTATIONS["alone_begins_at_once"]():
        found = replayed(written)
    assert " 1000 A starts weld" in found
    assert " 1000 A starts weld" not in written


def test_there_are_scripts() -> None:
    assert len(SCRIPTS) > 10
