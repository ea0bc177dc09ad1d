"""`mrbt sim estimate`: what it prints, and messages for bad input."""

from __future__ import annotations

import json

import pytest

from tests.support.command import EXPLORE, REPAIR, done, mrbt, refused

ONE = ("--jobs", "1")


def estimate(*arguments: str) -> tuple[int, str, str]:
    return mrbt("sim", "estimate", *arguments)


def test_figures_as_json() -> None:
    output = done(estimate(EXPLORE, "--runs", "6", "--fault-rate", "0.3", *ONE, "--json"))
    data = json.loads(output)
    assert (data["mission"], data["runs"], data["interrupted"]) == ("explore", 6, False)
    assert sum(data["results"].values()) == 6
    assert 0 <= data["success"]["low"] <= data["success"]["probability"]
    assert data["success"]["probability"] <= data["success"]["high"] <= 1
    again = estimate(EXPLORE, "--runs", "6", "--fault-rate", "0.3", "--jobs", "2", "--json")
    assert again[1] == output


def test_figures_for_people() -> None:
    output = done(estimate(EXPLORE, "--runs", "8", "--fault-rate", "0.4/action", *ONE))
    for text in ("8 runs", "95 % confidence", "success", "p50"):
        assert text in output


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--fault-rate", "1.5"], "0 to 1"),
        (["--fault-rate", "D4:0.1"], "'D4' is none of"),
        (["--fault-rate", "0.1/day"], "2/hour"),
        (["--minor-rate", "x"], "--minor-rate x"),
        (["--failure-rate", "fly:0.1"], "'fly' is none of"),
        (["--failure-rate", "2"], "0 to 1"),
        (["--return-after", "-1"], "is not in the range x>0"),
        (["--timeout", "0"], "x>=0.001"),
        (["--program", "nothing.py"], "nothing.py"),
        (["--runs", "0"], "--runs': 0 is not in the range x>=1"),
        (["--return-after", "5"], "--return-after: no robot dies"),
        (["--minor-rate", "1", "--return-after", "5"], "--return-after: no robot dies"),
        (["--repair-after", "5"], "--repair-after: no capability is lost"),
        (["--fault-rate", "A:0.1", "--fault-rate", "A:0.2"], "a rate was given for A before"),
        (["--failure-rate", "0.1", "--failure-rate", "0.2"], "a rate was given for all before"),
        (["--seed", "-1"], "is not in the range x>=0"),
        (["--major", "1"], "No such option '--major'"),
    ],
)
def test_bad_input_is_explained(options: list[str], text: str) -> None:
    assert text in " ".join(refused(estimate(REPAIR, *options)).split())
