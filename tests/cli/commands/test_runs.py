"""Listing teams, and robots' logs; what is refused. Teams are ended in tests/processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mrbt_mesh.cli.commands import runs
from mrbt_mesh.runtime.known_runs import remember
from mrbt_mesh.runtime.run_dir import RunDir
from tests.support.command import mrbt, refused
from tests.support.run_dirs import a_run


@pytest.fixture
def run_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunDir:
    """A run that is over, the only one that is known."""
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path / "state"))
    found = a_run(tmp_path / "over", {"R1": 0})
    found.write_summary({"result": "success"})
    remember(found)
    return found


def test_the_teams_are_listed_those_that_run_first(run_dir: RunDir, tmp_path: Path) -> None:
    running = a_run(tmp_path / "running", {"R1": os.getpid(), "R3": 0})
    remember(running)
    newest = a_run(tmp_path / "newest", {})
    remember(newest)
    (newest.path / "run.json").write_text("{")
    lines = mrbt("ls")[1].splitlines()
    assert [line.split()[0] for line in lines] == [
        *("team", running.info().team, "newest", run_dir.info().team)
    ]
    assert [line.split()[-2:] for line in lines[1:]] == [
        *(["1/3", "running"], ["0/0", "damaged"], ["0/2", "success"])
    ]
    (first, _, last) = json.loads(mrbt("ls", "--json")[1])["runs"]
    info = running.info()
    assert first == {
        "team": info.team,
        "mission": "explore",
        "run": info.run,
        "run_dir": str(running.path),
        "started_unix_s": info.started_unix_s,
        "robots": 3,
        "alive": 1,
        "result": "running",
    }
    assert (last["result"], last["alive"]) == ("success", 0)


def test_a_machine_without_runs_says_so(tmp_path: Path) -> None:
    assert "no run is known here" in mrbt("ls", MRBT_STATE_DIR=str(tmp_path))[1]
    assert runs._since(0).startswith(("1970-01-01", "1969-12-31"))


@pytest.mark.parametrize("command", [("down",), ("pause",), ("leave", "R1")])
def test_a_team_that_is_over_takes_no_orders(run_dir: RunDir, command: tuple[str, ...]) -> None:
    assert f"team {run_dir.info().team} does not run any more" in refused(mrbt(*command))


def test_a_team_is_named_once(run_dir: RunDir) -> None:
    assert "two ways to name a team" in refused(mrbt("down", "explore", "--run-dir", "explore"))


def log_line(event: str, level: str = "info", **fields: object) -> str:
    stamp = {"level": level, "timestamp": "2026-11-25T20:44:46.924304Z"}
    return json.dumps({"robot": "R1", **fields, "event": event, **stamp}) + "\n"


def test_a_log_is_printed_readably_with_what_the_program_printed(run_dir: RunDir) -> None:
    log = run_dir.log_path("R1")
    log.with_name("R1.log.1").write_text(log_line("old"))
    log.write_text(
        log_line("joined", incarnation="1.2")
        + log_line("robot_dead", "warning", robot="R2")
        + "no JSON\n"
        + "not whole"
    )
    run_dir.output_path("R1").write_text("hello\nworld\n")
    lines = mrbt("logs", "R1")[1].splitlines()
    assert lines[:2] == ["| hello", "| world"]
    assert [line.partition(" ")[2] for line in lines[2:]] == [
        *("old", "joined incarnation=1.2", "warning: robot_dead robot=R2", "JSON")
    ]
    assert mrbt("logs", "R1", "--lines", "1", "-f")[1] == "| world\nno JSON\n", "it is over"
    assert "has no robot 'R9'; known: R1, R2" in refused(mrbt("logs", "R9"))


def test_a_robot_that_runs_is_followed_until_it_ends(run_dir: RunDir, tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        running = a_run(tmp_path / "running", {"R1": process.pid})
        running.log_path("R1").write_text(log_line("joined"))
        words = [sys.executable, "-m", "mrbt_mesh", "logs", "R1", "-f"]
        with subprocess.Popen(
            [*words, "--run-dir", str(running.path)], stdout=subprocess.PIPE, text=True
        ) as following:
            assert following.stdout is not None
            assert "joined" in following.stdout.readline()
            with running.log_path("R1").open("a") as file:
                file.write(log_line("stopped"))
            assert "stopped" in following.stdout.readline()
            process.kill()
            process.wait()
            assert following.wait(timeout=60) == 0
