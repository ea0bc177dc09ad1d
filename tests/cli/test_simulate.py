"""`mrbt simulate`: what it prints and draws, and messages for bad input."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path

import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from mrbt_mesh.cli.simulate import simulate

EXAMPLES = Path(__file__).parents[2] / "examples"
REPAIR = str(EXAMPLES / "vehicle_repair" / "mission.yaml")
EXPLORE = str(EXAMPLES / "explore" / "mission.yaml")


def mrbt_simulate(*arguments: str) -> Result:
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command("simulate")(simulate)
    return CliRunner().invoke(app, [*arguments])


def test_figures_as_json() -> None:
    result = mrbt_simulate(EXPLORE, "--runs", "6", "--fault-rate", "0.3", "--jobs", "1", "--json")
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert (data["mission"], data["runs"], data["interrupted"]) == ("explore", 6, False)
    (point,) = data["points"]
    assert sum(point["results"].values()) == point["runs"] == 6
    assert 0 <= point["success"]["low"] <= point["success"]["probability"]
    assert point["success"]["probability"] <= point["success"]["high"] <= 1
    again = mrbt_simulate(EXPLORE, "--runs", "6", "--fault-rate", "0.3", "--jobs", "2", "--json")
    assert again.stdout == result.stdout


def test_figures_for_people() -> None:
    result = mrbt_simulate(EXPLORE, "--runs", "8", "--fault-rate", "0.4/action", "--jobs", "1")
    assert result.exit_code == 0, result.output
    for text in ("8 runs", "95 % confidence", "major", "mean", "p50", "by the faults"):
        assert text in result.stdout


def test_a_sweep_is_a_table_and_a_picture(tmp_path: Path) -> None:
    path = tmp_path / "out.png"
    options = ["--sweep", "major=0:1", "--sweep", "robots=1,2", "--jobs", "1"]
    result = mrbt_simulate(EXPLORE, "--runs", "2", *options, "--plot", str(path))
    assert result.exit_code == 0, result.output
    rows = [line.split() for line in result.stdout.splitlines()[2:] if line.strip()]
    assert [row[:2] for row in rows] == [["0", "1"], ["1", "1"], ["0", "2"], ["1", "2"]]
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", content[16:24])
    assert width > 1_000
    assert height > 400


def test_a_histogram_without_a_sweep(tmp_path: Path) -> None:
    path = tmp_path / "out.svg"
    result = mrbt_simulate(
        EXPLORE, "--runs", "6", "--fault-rate", "0.3", "--jobs", "1", "--plot", str(path)
    )
    assert result.exit_code == 0, result.output
    assert "<svg" in path.read_text()


def test_robots_do_not_load_what_draws() -> None:
    assert "matplotlib.pyplot" not in sys.modules
    import mrbt_mesh.sim.statistics.plotting as plotting

    assert not [name for name in vars(plotting) if name.startswith("matplotlib")]


def test_missing_matplotlib_is_said_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    path = str(tmp_path / "out.png")
    result = mrbt_simulate(EXPLORE, "--runs", "1", "--jobs", "1", "--plot", path)
    assert result.exit_code == 2
    assert "mrbt-mesh[plot]" in " ".join(result.output.split())


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
        (["--within", "nan"], "above 0"),
        (["--timeout", "0"], "above 0"),
        (["--plot", "/nowhere/at/all.png"], "no folder"),
        (["--program", "nothing.py"], "nothing.py"),
        (["--runs", "0"], "runs"),
    ],
)
def test_bad_input_is_explained(options: list[str], text: str) -> None:
    result = mrbt_simulate(REPAIR, *options)
    assert result.exit_code == 2, result.output
    assert text in " ".join(result.output.split())
    assert "Traceback" not in result.output


def test_a_picture_of_an_unknown_kind(tmp_path: Path) -> None:
    path = str(tmp_path / "out.doc")
    result = mrbt_simulate(EXPLORE, "--runs", "1", "--jobs", "1", "--plot", path)
    assert result.exit_code == 2
    assert "cannot be written" in " ".join(result.output.split())


def test_a_program_that_breaks_the_simulator_is_reported(tmp_path: Path) -> None:
    result = mrbt_simulate(str(tmp_path / "none.yaml"))
    assert result.exit_code == 2
