"""The command `mrbt` in this process, for commands that need no network."""

from __future__ import annotations

from click.testing import CliRunner

from mrbt_mesh.cli.main import main
from tests.support.paths import mission_file

REPAIR = str(mission_file("vehicle_repair"))
EXPLORE = str(mission_file("explore"))
COURIERS = str(mission_file("couriers"))


def mrbt(*arguments: str, **variables: str) -> tuple[int, str, str]:
    """(exit status, stdout, stderr) of a command that needs no network."""
    result = CliRunner().invoke(main, list(arguments), env={"COLUMNS": "200", **variables})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def done(ended: tuple[int, str, str]) -> str:
    """The output of a command that has to succeed."""
    code, output, problems = ended
    assert code == 0, problems or output
    return output


def refused(ended: tuple[int, str, str]) -> str:
    """What is said of a mistake: with exit status 2, no output, and without a traceback."""
    code, output, problems = ended
    assert (code, output) == (2, ""), problems
    assert "Traceback" not in problems
    return problems
