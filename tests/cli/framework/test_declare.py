"""Commands out of functions: what is declared is what is taken, and how it arrives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from click.testing import CliRunner

from mrbt_mesh.cli.framework.declare import Given, argument, command, option
from mrbt_mesh.errors import InputError


@dataclass(frozen=True)
class Weather:
    """A group of options, as several commands may take it."""

    rain: Annotated[float, option("How much.", least=0, most=1)] = 0.5
    wind: Annotated[tuple[str, ...], option("From where.", "NORTH")] = ()


def taken(function: Any, *arguments: str, **variables: str) -> tuple[int, str]:
    """(exit status, what was written to stderr)."""
    result = CliRunner().invoke(command(function), list(arguments), env=variables)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stderr


def test_every_kind_of_value_arrives_with_its_type() -> None:
    found: dict[str, Any] = {}

    def act(
        name: Annotated[str, argument("NAME", "A name.")],
        *,
        weather: Weather,
        count: Annotated[int, option("How many.")] = 1,
        at: Annotated[Path | None, option("Where.", short="-a")] = None,
        colour: Annotated[Literal["red", "blue"], option("Which.")] = "red",
        is_loud: Annotated[bool, option("Or not.", name="--loud")] = False,
        given: Given,
    ) -> None:
        found.update(locals())

    assert taken(act, "x") == (0, "")
    assert found.pop("given").names == ("NAME",)
    assert {key: found[key] for key in ("name", "count", "at", "colour", "is_loud")} == {
        "name": "x",
        "count": 1,
        "at": None,
        "colour": "red",
        "is_loud": False,
    }
    assert found["weather"] == Weather(0.5, ())
    words = ["--count", "3", "-a", "b/c", "--loud", "--wind", "n", "--wind", "e", "--rain", "1"]
    assert taken(act, "y", *words, "--colour", "blue") == (0, "")
    assert (found["count"], found["at"], found["is_loud"]) == (3, Path("b/c"), True)
    assert (found["colour"], found["weather"]) == ("blue", Weather(1.0, ("n", "e")))
    names = ("NAME", "--rain", "--wind", "--count", "--at", "--colour", "--loud")
    assert found["given"].names == names


def test_what_a_variable_says_is_given_too() -> None:
    found: list[Given] = []

    def act(
        given: Given, who: Annotated[str | None, option("Who.", variable="WHO")] = None
    ) -> None:
        found.append(given)

    taken(act)
    taken(act, WHO="me")
    taken(act, WHO="")
    assert [given.names for given in found] == [(), ("--who",), ()]


def test_an_option_that_does_not_apply_is_refused_by_its_name() -> None:
    given = Given(("--seed", "MISSION", "--json"))
    given.refuse(["--loss"], "never")
    given.refuse_all_but(["MISSION", "--seed", "--json", "--log"], "never")
    with pytest.raises(InputError, match=r"^--seed, --json: not here$"):
        given.refuse(["--json", "--seed", "--loss"], "not here")
    with pytest.raises(InputError, match=r"^--json: not here$"):
        given.refuse_all_but(["MISSION", "--seed"], "not here")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "Missing option '--count'"),
        (["--count", "x"], "'--count': x: expected a whole number"),
        (["--count", "1", "--count", "2"], "--count is given 2 times"),
        (["--count", "1", "--at", ""], "'' is no path"),
        (["--count", "1", "--at", "x" * 300], "the name is too long"),
        (["--count", "1", "--coutn", "2"], "No such option '--coutn'. Did you mean '--count'?"),
        (["--count", "1", "more"], "Got unexpected extra argument (more)"),
        (["--count"], "Option '--count' requires an argument"),
    ],
)
def test_what_cannot_be_taken_is_status_2_and_a_message(words: list[str], message: str) -> None:
    def act(
        count: Annotated[int, option("How many.")],
        at: Annotated[Path | None, option("Where.")] = None,
    ) -> None:
        raise AssertionError("called")

    code, problems = taken(act, *words)
    assert (code, message in problems) == (2, True), problems
    assert problems.startswith("error: ")


def test_wrong_input_found_by_the_command_is_status_2_and_a_message() -> None:
    def act() -> None:
        raise InputError("[this] is wrong")

    assert taken(act) == (2, "error: [this] is wrong\n")


def test_other_errors_are_not_hidden() -> None:
    def act() -> None:
        raise ValueError("a bug")

    with pytest.raises(ValueError, match="a bug"):
        taken(act)


def test_a_command_that_is_declared_wrongly_is_refused_at_once() -> None:
    def twice(weather: Weather, rain: Annotated[float, option("Again.")] = 0) -> None: ...

    with pytest.raises(TypeError, match="two parameters of the same name"):
        command(twice)

    def bare(rain: float = 0) -> None: ...

    with pytest.raises(TypeError, match="rain: not declared"):
        command(bare)

    def odd(rain: Annotated[complex, option("How much.")] = 0j) -> None: ...

    with pytest.raises(TypeError, match="rain: a command cannot take a value of the type"):
        command(odd)
