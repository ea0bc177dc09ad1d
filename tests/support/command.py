"""The command `mrbt` in this process, for commands that need no network."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from mrbt_mesh.cli.app import app

ROOT = Path(__file__).resolve().parents[2]
REPAIR = str(ROOT / "examples" / "vehicle_repair" / "mission.yaml")
EXPLORE = str(ROOT / "examples" / "explore" / "mission.yaml")
COURIERS = str(ROOT / "examples" / "couriers" / "mission.yaml")


def mrbt(*arguments: str) -> tuple[int, str, str]:
    """(exit status, stdout, stderr) of a command that needs no network."""
    result = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200"})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr
