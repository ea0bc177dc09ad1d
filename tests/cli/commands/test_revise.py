"""What `mrbt revise` refuses before it asks the team."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from mrbt_mesh.cli.commands.revise import revise
from mrbt_mesh.cli.team_options import TeamOptions

FILE = """
mission: m
program: robot.py
local_tasks: {w: {work: 1}}
robot_types: {r: {capabilities: {w: 1}}}
robots: {A1: r}
global_tasks: {t: {needs: {w: {}}}}
tree: t
"""


def test_a_program_that_does_not_exist_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that joins later would load it."""
    new = tmp_path / "new.yaml"
    new.write_text(FILE)
    address = SimpleNamespace(run_dir=tmp_path)
    monkeypatch.setattr(TeamOptions, "find_running", lambda _: address)
    for dry_run in ([], ["--dry-run"]):
        found = CliRunner().invoke(revise, [str(new), *dry_run])
        assert found.exit_code == 2, found.output
        assert f"{tmp_path / 'robot.py'}: there is no such file" in found.output
