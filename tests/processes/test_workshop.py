"""The workshop with real processes: the world is one, each robot another, and one robot is killed.

`make test-world` gets what this needs.
"""

from __future__ import annotations

import json
import logging
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import EXAMPLES, mission_file
from tests.support.team import Team
from tests.support.workshop import needs_world

needs_world()
pytestmark = pytest.mark.slow

# How long it took: `pytest --log-cli-level=info`.
LOG = logging.getLogger(__name__)
WORKSHOP = EXAMPLES / "workshop"


def test_another_robot_drives_to_where_one_was_killed(team: Team) -> None:
    """One of the two runs of the example's own drill; the world is asked in the end."""
    text = (WORKSHOP / "drill.yaml").read_text(encoding="utf-8")
    one = text.replace("[do_diagnosis(2), replace_hw(2)]", "[replace_hw(2)]")
    one = one.replace("mission.yaml", str(WORKSHOP / "mission.yaml"))
    one = one.replace("python world.py", f"python '{WORKSHOP / 'world.py'}'")
    assert one != text
    path = team.folder / "drill.yaml"
    path.write_text(one, encoding="utf-8")
    done = team.command("drill", str(path), "--json", "--brief")
    report = json.loads(done.stdout)
    assert done.returncode == 0, json.dumps(report, indent=1)
    (run,) = report["runs"]
    said = [each["found"] for each in run["expectations"] if "--judge" in each["expected"]]
    assert said == ["the vehicle is mended: new parts 2, the cover and its screws in place"]
    (takeover,) = (each for each in run["takeovers"] if each["inflicted"])
    LOG.info("detected %.3f s, reassigned %.3f s", takeover["detected_s"], takeover["reassigned_s"])


def test_robots_without_a_world_can_do_nothing_until_there_is_one(
    team: Team, tmp_path: Path
) -> None:
    socket = tmp_path / "w.sock"
    team.environment["WORKSHOP_WORLD"] = str(socket)
    team.up(mission_file("workshop"))
    team.wait_for_line("blocked")
    assert team.events() == []
    there = subprocess.Popen(
        [sys.executable, str(WORKSHOP / "world.py")],
        env=team.environment,
        stdout=subprocess.DEVNULL,
    )
    try:
        team.wait_for_event("use_screwdriver")
    finally:
        there.terminate()
        there.wait()
