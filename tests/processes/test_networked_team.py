"""Robots and observers that share nothing but a network: no run directory, no launcher."""

from __future__ import annotations

import json
import re
import secrets
import signal
import subprocess
from typing import Any

import pytest

from mrbt_mesh.runtime.launcher import free_endpoints
from tests.support.team import EXPLORE, TEST_TIMEOUT_S, Team

pytestmark = [pytest.mark.processes, pytest.mark.slow, pytest.mark.timeout(TEST_TIMEOUT_S)]


def robots(team: Team, *options: str) -> dict[str, subprocess.Popen[str]]:
    """Both robots of the mission, each with a folder of its own."""
    return {
        robot: team.agent(EXPLORE, robot, "--run-dir", str(team.folder / robot), *options)
        for robot in ("R1", "R2")
    }


def status(team: Team, *where: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(team.mrbt("status", "--json", *where))
    return found


def events(team: Team, robot: str) -> list[tuple[str, str | None]]:
    path = team.folder / robot / "events.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    return [(line["event"], line["outcome"]) for line in map(json.loads, lines)]


def test_a_team_found_by_multicast_is_watched_asked_and_told(team: Team) -> None:
    name = ["--team", f"multicast-{secrets.token_hex(4)}", "--run", "first", "--multicast", "lo"]
    where = ["--mission", str(EXPLORE), *name]
    team.hold("explore")
    observer = team.start("watch", "--json", *where)
    started = robots(team, "--speed", "10", *name)
    team.wait_until(lambda: events(team, "R1") and events(team, "R2"), "both robots work")
    assert "pause is the team's order" in team.mrbt("pause", *where)
    team.wait_until(lambda: ("cancel", None) in events(team, "R1"), "R1 pauses")
    process_file = team.folder / "R1" / "R1.process"
    first_sign_ns = process_file.stat().st_mtime_ns
    found = status(team, *where)
    assert {robot: row["pid"] for robot, row in found["robots"].items()} == {
        robot: process.pid for robot, process in started.items()
    }
    assert {row["state"] for row in found["robots"].values()} == {"alive"}
    assert found["run_dir"] is None
    assert "R2 has lost explore" in team.mrbt("fault", "R2", "explore", *where)
    assert status(team, *where)["robots"]["R2"]["lost"] == {"explore": "operator"}
    team.mrbt("fault", "R2", "all", "--end", *where)
    team.mrbt("resume", *where)
    team.release()
    assert "no robot R9 (R1, R2)" in team.command("leave", "R9", *where).stderr
    output, problems = observer.communicate()
    assert observer.returncode == 0, problems
    summary = json.loads(output)
    assert summary["result"] == "success"
    assert set(summary["robots"]) == {"R1", "R2"}
    assert process_file.stat().st_mtime_ns > first_sign_ns, "a working robot shows signs of life"
    # The robots stay on duty, and whoever comes late learns the result.
    late = team.command("watch", *where)
    assert late.returncode == 0
    assert "mission succeeded" in late.stdout
    team.mrbt("leave", "R1", *where)
    assert started["R1"].wait() == 0


def test_a_team_with_endpoints_is_watched_by_dialling_them(team: Team) -> None:
    team.hold("explore")
    first, second = free_endpoints(2, "tcp")
    for robot, options in (("R1", ["--listen", first]), ("R2", ["--listen", second])):
        options += ["--speed", "10", *(["--connect", first] if robot == "R2" else [])]
        team.agent(EXPLORE, robot, *options)
    where = ["--mission", str(EXPLORE), "--connect", first, "--connect", second]
    observer = team.start("watch", "--headless", *where)
    team.wait_until(lambda: len(status(team, *where)["robots"]) == 2, "both are heard")
    team.mrbt("abort", *where)
    output, problems = observer.communicate()
    assert observer.returncode == 1, problems
    assert output.startswith("listening for team explore, run ")
    assert re.search(r"\d\.\d\d  R1 joined", output)
    assert "mission failed" in output


def test_who_looks_for_another_run_is_told_so(team: Team) -> None:
    name = ["--team", f"multicast-{secrets.token_hex(4)}", "--multicast", "lo"]
    team.hold("explore")
    robots(team, "--run", "first", *name)
    team.wait_until(lambda: events(team, "R1"), "R1 works")
    where = ["--mission", str(EXPLORE), "--run", "second", *name]
    asked = team.command("status", *where)
    assert asked.returncode == 1
    assert "run second, answers; R1: run 'first' (ours is 'second')" in asked.stderr
    watching = team.start("watch", *where)
    assert watching.stdout is not None
    told = "R1 is not of this run: run 'first' (ours is 'second')"
    assert any(told in line for line in watching.stdout)
    watching.send_signal(signal.SIGINT)
    output, _ = watching.communicate()
    assert watching.returncode == 3
    assert "mission not started: its team has not gathered" in output
