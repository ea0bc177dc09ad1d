"""What `mrbt` adds to click: messages with status 2, values, options as one object, the help."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from mrbt_mesh.cli.command import (
    PATH,
    FiniteNumber,
    LateGroup,
    MrbtCommand,
    NumbersCommand,
    options_as,
    refuse,
    used,
)
from mrbt_mesh.errors import InputError
from mrbt_mesh.plugins import COMMANDS


@dataclass(frozen=True)
class Weather:
    """Options that several commands may take."""

    rain: float
    wind: tuple[str, ...]


@click.command(cls=MrbtCommand)
@click.argument("name", metavar="[NAME]", required=False)
@click.option("--count", type=click.IntRange(0))
@click.option("--at", type=PATH)
@click.option("--share", type=FiniteNumber(0, 1, min_open=True))
@click.option("--loud", is_flag=True)
@options_as(
    "weather",
    Weather,
    click.option("--rain", type=FiniteNumber(0), default=0.5, envvar="RAIN"),
    click.option("--wind", multiple=True),
)
def act(**values: Any) -> None:
    """Do something."""
    if values["name"] == "wrong":
        raise InputError("[this] is wrong")
    if values["name"] == "bug":
        raise ValueError("a bug")
    if values["name"] == "quiet":
        refuse("not here", "--loud", "--rain")
    click.echo(f"{values['weather']} {used()}")


def taken(*arguments: str, **variables: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(act, list(arguments), env=variables)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def test_options_arrive_as_one_object_and_it_is_known_which_were_used() -> None:
    assert taken() == (0, f"{Weather(0.5, ())} []\n", "")
    words = ("x", "--wind", "n", "--wind", "e", "--rain", "1")
    assert taken(*words) == (0, f"{Weather(1.0, ('n', 'e'))} ['NAME', '--rain', '--wind']\n", "")


def test_a_variable_counts_as_its_option() -> None:
    assert taken(RAIN="2") == (0, f"{Weather(2.0, ())} ['--rain']\n", "")
    assert taken(RAIN="") == taken()
    code, _, problems = taken("quiet", "--loud", RAIN="2")
    assert (code, problems) == (2, "error: --loud, --rain: not here\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--count", "x"], "'--count': 'x' is not a valid integer"),
        (["--count", "-1"], "-1 is not in the range x>=0"),
        (["--count", "1", "--count", "2"], "--count is given 2 times"),
        (["--at", ""], "'--at': it is empty"),
        (["--at", "x" * 300], "the name is too long"),
        ([""], "'[NAME]': it is empty"),
        (["--share", "0"], "0.0 is not in the range 0<x<=1"),
        (["--share", "nan"], "nan: a number of at most 1000000000 is expected"),
        (["--rain", "inf"], "inf: a number of at most"),
        (["--rain", "1e300"], "1e300: a number of at most"),
        (["--coutn", "2"], "No such option '--coutn'. (Did you mean one of: '--count'"),
        (["x", "more"], "Got unexpected extra argument (more)"),
        (["--count"], "Option '--count' requires an argument"),
        (["wrong"], "error: [this] is wrong\n"),
    ],
)
def test_what_cannot_be_taken_is_status_2_and_a_message(words: list[str], message: str) -> None:
    code, output, problems = taken(*words)
    assert (code, output, message in problems) == (2, "", True), problems
    assert problems.startswith("error: ")


def test_flags_may_be_repeated_and_large_numbers_given() -> None:
    assert taken("--loud", "--loud", "--count", "1234567890123")[0] == 0


def test_other_errors_are_not_hidden() -> None:
    with pytest.raises(ValueError, match="a bug"):
        taken("bug")


def test_what_one_task_raises_in_a_task_group_is_the_error() -> None:
    @click.command(cls=MrbtCommand)
    def grouped() -> None:
        raise ExceptionGroup("tasks", [ExceptionGroup("inner", [InputError("wrong")])])

    result = CliRunner().invoke(grouped, [])
    assert (result.exit_code, result.stderr) == (2, "error: wrong\n")


def test_a_path_is_a_path() -> None:
    assert PATH.convert("a/b", None, None) == Path("a/b")


def test_a_group_adds_the_plugins_of_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = {"wood": click.Group("wood", help="Trees."), "wood.cut": click.Command("cut")}
    monkeypatch.setattr(type(COMMANDS), "names", lambda self: sorted(loaded))
    monkeypatch.setattr(type(COMMANDS), "load", lambda self, name: loaded[name])
    group = LateGroup({}, {}, COMMANDS, name="mrbt")
    context = click.Context(group, info_name="mrbt")
    assert group.list_commands(context) == ["wood"]
    wood = group.get_command(context, "wood")
    assert isinstance(wood, click.Group)
    assert [*wood.commands] == ["cut"]
    assert "wood  Trees." in group.get_help(context)


@click.command(cls=NumbersCommand)
@click.argument("kind", required=False)
@click.argument("words", nargs=-1)
@click.option("--priority", type=int)
def sum_up(kind: str | None, words: tuple[str, ...], priority: int | None) -> None:
    """Take numbers."""
    click.echo(f"{kind} {words} {priority}")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("move 3 -4", "move ('3', '-4') None"),
        ("move -35 --priority -2 -1.5", "move ('-35', '-1.5') -2"),
        ("--priority 7 -- -x -5", "-x ('-5',) 7"),
        ("move -", "move ('-',) None"),
        ("", "None () None"),
        ("-7", "-7 () None"),
    ],
)
def test_negative_numbers_are_arguments(given: str, said: str) -> None:
    result = CliRunner().invoke(sum_up, given.split())
    assert (result.exit_code, result.output) == (0, f"{said}\n")


@pytest.mark.parametrize("given", ["move --prioriy 3", "-x 3", "--priority 1 -4x -- 3"])
def test_other_options_that_there_are_not_are_refused(given: str) -> None:
    result = CliRunner().invoke(sum_up, given.split())
    assert result.exit_code == 2
    assert "No such option" in result.output
