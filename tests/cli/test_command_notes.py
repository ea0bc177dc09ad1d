"""A command that cannot be noted was carried out all the same: a warning says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.cli.command_notes import note_command
from mrbt_mesh.runtime.command_log import noted_commands
from mrbt_mesh.runtime.run_dir import COMMANDS_FILE
from tests.support.run_dirs import a_run


def test_a_command_is_noted_by_its_name(tmp_path: Path) -> None:
    run_dir = a_run(tmp_path / "r", {})
    note_command(run_dir, "kill", "A1 killed", 7.0)
    content = (run_dir.path / COMMANDS_FILE).read_bytes()
    (noted,) = noted_commands(content, run_dir.info().run, None)
    assert (noted.by, noted.command, noted.unix_s) == ("mrbt kill", "A1 killed", 7.0)


def test_if_it_cannot_be_noted_a_warning_is_printed_or_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_dir = a_run(tmp_path / "r", {})
    (run_dir.path / COMMANDS_FILE).mkdir()
    note_command(run_dir, "kill", "A1 killed")
    printed = capsys.readouterr().err
    assert printed.startswith("mrbt: warning: ")
    assert "the command is not noted for reports" in printed
    kept: list[str] = []
    note_command(run_dir, "demo", "A1 killed", warn=kept.append)
    assert [f"{text}\n" for text in kept] == [printed]
    assert capsys.readouterr().err == ""
