"""Help screens: all that is declared is on them, also in a narrow terminal and in colours."""

from __future__ import annotations

import sys
from typing import Annotated

import click
import pytest

from mrbt_mesh.cli.framework.declare import argument, command, option
from tests.support.command import mrbt


def act(
    name: Annotated[str, argument("NAME", "Who it is.")],
    more: Annotated[tuple[str, ...], argument("MORE", "Others.")] = (),
    loss: Annotated[float, option("Share that is [lost].", least=0, most=1, panel="Chance")] = 0.25,
    log: Annotated[str | None, option("Write there.", "FILE", short="-l", variable="LOG")] = None,
    brief: Annotated[bool, option("Say less.")] = False,
) -> None:
    """Do something that takes
    two lines.

    It is explained here.

    Example: act x --loss 1
    """


def screen(width: int, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("COLUMNS", str(width))
    made = command(act)
    return made.get_help(click.Context(made, info_name="act"))


def test_all_that_is_declared_is_on_the_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    text = screen(100, monkeypatch)
    lines = [" ".join(line.strip("│ ").split()) for line in text.splitlines()]
    for line in (
        "Usage: act [OPTIONS] NAME [MORE]...",
        "Do something that takes two lines.",
        "It is explained here.",
        "Example: act x --loss 1",
        "NAME <text> Who it is. [required]",
        "MORE... <text> Others.",
        "--log, -l FILE Write there. [variable: LOG]",
        "--brief Say less.",
        "--loss <number> Share that is [lost]. [0 to 1; default: 0.25]",
    ):
        assert line in lines, line
    titles = [line.split()[1] for line in text.splitlines() if line.startswith("╭")]
    assert titles == ["Arguments", "Options", "Chance"]


@pytest.mark.parametrize("width", [40, 60, 80, 200])
def test_no_line_is_wider_than_the_terminal(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert max(map(len, screen(width, monkeypatch).splitlines())) <= width


def test_it_is_plain_in_a_file_and_in_colours_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\033[" not in screen(80, monkeypatch)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert "\033[" in screen(80, monkeypatch)


def test_the_list_of_commands_fits_a_usual_terminal() -> None:
    _, output, _ = mrbt("--help", COLUMNS="80")
    assert max(map(len, output.splitlines())) <= 80
