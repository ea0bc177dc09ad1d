"""`mrbt estimate`: what it prints and draws, and messages for bad input."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path

import pytest

from tests.support.command import EXPLORE, REPAIR, mrbt

ONE = ("--jobs", "1")


def estimate(*arguments: str) -> tuple[int, str, str]:
    return mrbt("estimate", *arguments)


def test_figures_as_json() -> None:
    code, output, problems = estimate(EXPLORE, "--runs", "6", "--fault-rate", "0.3", *ONE, "--json")
    assert code == 0, problems
    data = json.loads(output)
    assert (data["mission"], data["runs"], data["interrupted"]) == ("explore", 6, False)
    (point,) = data["points"]
    assert sum(point["results"].values()) == point["runs"] == 6
    assert 0 <= point["success"]["low"] <= point["success"]["probability"]
    assert point["success"]["probability"] <= point["success"]["high"] <= 1
    again = estimate(EXPLORE, "--runs", "6", "--fault-rate", "0.3", "--jobs", "2", "--json")
    assert again[1] == output


def test_figures_for_people() -> None:
    code, output, problems = estimate(EXPLORE, "--runs", "8", "--fault-rate", "0.4/action", *ONE)
    assert code == 0, problems
    for text in ("8 runs", "95 % confidence", "major", "mean", "p50", "by the faults"):
        assert text in output


def test_a_sweep_is_a_table_and_a_picture(tmp_path: Path) -> None:
    path = tmp_path / "out.png"
    options = ["--sweep", "major=0:1", "--sweep", "robots=1,2", *ONE]
    code, output, problems = estimate(EXPLORE, "--runs", "2", *options, "--plot", str(path))
    assert code == 0, problems
    rows = [line.split() for line in output.splitlines()[2:] if line.strip()]
    assert [row[:2] for row in rows] == [["0", "1"], ["1", "1"], ["0", "2"], ["1", "2"]]
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", content[16:24])
    assert width > 1_000
    assert height > 400


def test_a_histogram_without_a_sweep(tmp_path: Path) -> None:
    path = tmp_path / "out.svg"
    code, _output, problems = estimate(
        EXPLORE, "--runs", "6", "--fault-rate", "0.3", *ONE, "--plot", str(path)
    )
    assert code == 0, problems
    assert "<svg" in path.read_text()


def test_robots_do_not_load_what_draws() -> None:
    assert "matplotlib.pyplot" not in sys.modules
    import mrbt_mesh.sim.statistics.plotting as plotting

    assert not [name for name in vars(plotting) if name.startswith("matplotlib")]


def test_missing_matplotlib_is_said_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    path = str(tmp_path / "out.png")
    code, _, problems = estimate(EXPLORE, "--runs", "1", *ONE, "--plot", path)
    assert code == 2
    assert "mrbt-mesh[plot]" in " ".join(problems.split())


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--fault-rate", "1.5"], "0 to 1"),
        (["--fault-rate", "D4:0.1"], "no robot or type 'D4'"),
        (["--fault-rate", "0.1/day"], "2/hour"),
        (["--minor-rate", "x"], "--minor-rate x"),
        (["--failure-rate", "fly:0.1"], "no local task 'fly'"),
        (["--failure-rate", "2"], "0 to 1"),
        (["--major", "7"], "only 6 robots"),
        (["--minor", "19"], "only 18 capabilities"),
        (["--sweep", "weather=1"], "NAME=VALUES"),
        (["--sweep", "robots=0"], "whole number"),
        (["--robots", "9999"], "1 to 1000 robots"),
        (["--return-after", "-1"], "above 0"),
        (["--major", "1", "--within", "nan"], "above 0"),
        (["--timeout", "0"], "0.001 or more"),
        (["--plot", "/nowhere/at/all.png"], "no folder"),
        (["--program", "nothing.py"], "nothing.py"),
        (["--runs", "0"], "--runs': 0: expected a whole number, 1 or more"),
        (["--within", "5"], "for --major and --minor, of which there are none"),
        (["--return-after", "5"], "--return-after: no robot dies"),
        (["--minor", "1", "--return-after", "5"], "--return-after: no robot dies"),
        (["--repair-after", "5"], "--repair-after: no capability is lost"),
        (["--sweep", "minor=0:2", "--minor", "1"], "--minor: --sweep minor gives its values"),
        (["--sweep", "robots=1,2", "--robots", "3"], "--robots: --sweep robots gives"),
        (["--sweep", "fault-rate=0.1,0.2", "--fault-rate", "0.3"], "--fault-rate for everybody"),
        (["--fault-rate", "A:0.1", "--fault-rate", "A:0.2"], "given before, as A:0.1"),
        (["--failure-rate", "0.1", "--failure-rate", "0.2"], "given before, as 0.1"),
        (["--robots", "3", "--fault-rate", "A1:0.1"], "A1: not in a team of that size"),
        (["--seed", "-1"], "expected a whole number, 0 or more"),
        (["--speed", "1e9"], "0.01 to 1000"),
        (["--kill", "A1@3"], "No such option '--kill'"),
    ],
)
def test_bad_input_is_explained(options: list[str], text: str) -> None:
    code, output, problems = estimate(REPAIR, *options)
    assert (code, output) == (2, "")
    assert text in " ".join(problems.split())
    assert "Traceback" not in problems


def test_a_picture_of_an_unknown_kind(tmp_path: Path) -> None:
    path = str(tmp_path / "out.doc")
    code, _, problems = estimate(EXPLORE, "--runs", "1", *ONE, "--plot", path)
    assert code == 2
    assert "no kind of picture is known by that ending" in problems
    assert ".png" in problems


def test_settings_that_no_team_can_suffer_are_left_out_and_counted() -> None:
    arguments = ("--runs", "1", *ONE, "--sweep", "major=0:3", "--json")
    code, output, problems = estimate(EXPLORE, *arguments)
    assert code == 0
    assert [point["major"] for point in json.loads(output)["points"]] == ["0", "1", "2"]
    assert "left out: 1 of 4 settings" in problems
