"""Robots and observers that share nothing but a network: no run directory, no launcher."""

from __future__ import annotations

import json
import re
import secrets
import signal
import subprocess

import pytest

from mrbt_mesh.runtime.launcher import free_endpoints
from tests.support.team import EXPLORE, Team

pytestmark = pytest.mark.slow


def robots(team: Team, *options: str) -> dict[str, subprocess.Popen[str]]:
    """Both robots of the mission, each with a folder of its own."""
    return {
        robot: team.agent(EXPLORE, robot, "--run-dir", str(team.folder / robot), *options)
        for robot in ("R1", "R2")
    }


def events(team: Team, robot: str) -> list[tuple[str, str | None]]:
    path = team.folder / robot / "events.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    return [(line["event"], line["outcome"]) for line in map(json.loads, lines)]


def test_a_team_found_by_multicast_is_watched_asked_and_told(team: Team) -> None:
    name = f"multicast-{secrets.token_hex(4)}"
    there = team.at(mission=EXPLORE, team=name, run="first", multicast="lo")
    team.hold("explore")
    observer = there.start("watch", "--json")
    started = robots(there, "--speed", "10")
    team.wait_until(lambda: events(team, "R1") and events(team, "R2"), "both robots work")
    assert "pause is the team's command" in there.mrbt("pause")
    team.wait_until(lambda: ("cancel", None) in events(team, "R1"), "R1 pauses")
    process_file = team.folder / "R1" / "R1.process"
    first_sign_ns = process_file.stat().st_mtime_ns
    found = there.status()
    assert {robot: row["pid"] for robot, row in found["robots"].items()} == {
        robot: process.pid for robot, process in started.items()
    }
    assert {row["state"] for row in found["robots"].values()} == {"alive"}
    assert found["run_dir"] is None
    assert "R2 has lost explore" in there.mrbt("fault", "R2", "explore")
    assert there.status()["robots"]["R2"]["lost"] == {"explore": "operator"}
    there.mrbt("fault", "R2", "all", "--end")
    there.mrbt("resume")
    team.release()
    assert "no robot R9 (R1, R2)" in there.command("leave", "R9").stderr
    output, problems = observer.communicate()
    assert observer.returncode == 0, problems
    summary = json.loads(output)
    assert summary["result"] == "success"
    assert set(summary["robots"]) == {"R1", "R2"}
    assert process_file.stat().st_mtime_ns > first_sign_ns, "a working robot shows signs of life"
    # The robots stay on duty, and whoever comes late learns the result.
    late = there.command("watch")
    assert late.returncode == 0
    assert "mission succeeded" in late.stdout
    there.mrbt("leave", "R1")
    assert started["R1"].wait() == 0


def test_a_team_with_endpoints_is_watched_by_dialling_them(team: Team) -> None:
    team.hold("explore")
    first, second = free_endpoints(2, "tcp")
    for robot, options in (("R1", ["--listen", first]), ("R2", ["--listen", second])):
        options += ["--speed", "10", *(["--connect", first] if robot == "R2" else [])]
        team.agent(EXPLORE, robot, *options)
    there = team.at(mission=EXPLORE, connect=f"{first},{second}")
    observer = there.start("watch", "--headless")
    team.wait_until(lambda: len(there.status()["robots"]) == 2, "both are heard")
    there.mrbt("abort")
    output, problems = observer.communicate()
    assert observer.returncode == 1, problems
    assert output.startswith("listening for team explore, run ")
    assert re.search(r"\d\.\d\d  R1 joined", output)
    assert "mission aborted" in output


def test_who_looks_for_another_run_is_told_so(team: Team) -> None:
    there = team.at(
        mission=EXPLORE, team=f"multicast-{secrets.token_hex(4)}", run="second", multicast="lo"
    )
    team.hold("explore")
    robots(there, "--run", "first")
    team.wait_until(lambda: events(team, "R1"), "R1 works")
    asked = there.command("status")
    assert asked.returncode == 1
    assert "run second, answers; R1: run 'first' (ours is 'second')" in asked.stderr
    watching = there.start("watch")
    assert watching.stdout is not None
    told = "R1 is not of this run: run 'first' (ours is 'second')"
    assert any(told in line for line in watching.stdout)
    watching.send_signal(signal.SIGINT)
    output, _ = watching.communicate()
    assert watching.returncode == 3
    assert "mission not started: its team has not gathered" in output
