"""Another mission for real processes that run."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from tests.support.paths import ROOT, mission_file
from tests.support.team import Team

DELIVERIES = mission_file("deliveries")


def revised(folder: Path) -> Path:
    """Another drone, no fourth cart, and one more type of jobs."""
    text = DELIVERIES.read_text().replace("../../agents", str(ROOT / "agents"))
    text = text.replace("C4: station_2, ", "").replace(
        "D2: station_2}", "D2: station_2, D3: dock_1}"
    )
    text = text.replace("C4: cart, ", "").replace("D2: drone}", "D2: drone, D3: drone}")
    text = text.replace("    tree: watch($where)\n", "    tree: watch($where)\n" + RECHECK)
    text = text.replace("types: [deliver, inspect]", "types: [deliver, inspect, recheck]")
    found = folder / "revised.yaml"
    found.write_text(text)
    return found


RECHECK = """  recheck:
    parameters: {where: place}
    tree: {Sequence: [watch($where), watch(dock_1)]}
"""


@pytest.mark.smoke
def test_a_team_takes_up_another_mission_while_it_works(team: Team, tmp_path: Path) -> None:
    team.hold("look")
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    team.mrbt("submit", "inspect", "shelf_2", "--id", "before")
    begun = team.wait_for_event("look", args=["shelf_2"])
    away = next(robot for robot in ("D1", "D2") if robot != begun["robot"])
    team.signal(away, signal.SIGKILL)
    team.wait_for_line(f"{away} is dead")
    new = revised(tmp_path)
    would_be = team.command("revise", str(new), "--dry-run", "--json")
    told = json.loads(would_be.stdout)
    assert would_be.returncode == 1
    assert told["refused"] == [
        "C4 is alive and would leave: keep C4 in it, or use --force",
    ]
    team.mrbt("revise", str(new), "--dry-run", "--force")
    assert [row[0] for row in told["going_on"]] == [begun["robot"]]
    assert (told["new_robots"], told["removed_robots"]) == (["D3"], ["C4"])
    assert f"any one robot (except {begun['robot']})" in told["survives"]["inspect"]
    assert "revision 1 is in force" in team.mrbt("revise", str(new), "--force")
    # The one that works goes on; the one that was away takes it up before it joins.
    team.mrbt("join", away)
    team.mrbt("join", "D3")
    team.wait_until(lambda: team.log("C4")[-1]["event"] == "stopped", "C4 has left")
    team.release("look")
    team.mrbt("submit", "recheck", "shelf_3", "--id", "after", "--wait")
    jobs = {row["id"]: row["state"] for row in json.loads(team.mrbt("jobs", "--json"))}
    assert jobs == {"before": "succeeded", "after": "succeeded"}
    starts = [each for each in team.events() if each["event"] == "start"]
    assert sum(each["args"] == ["shelf_2"] for each in starts if each["local_task"] == "look") == 1
    team.mrbt("down")
    assert "proved" in team.mrbt("recording", "verify", str(team.run_dir))


def test_a_robot_at_work_refuses_what_would_cancel_it(team: Team, tmp_path: Path) -> None:
    team.hold("look")
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    team.mrbt("submit", "inspect", "shelf_2", "--id", "held")
    team.wait_for_event("look", args=["shelf_2"])
    text = DELIVERIES.read_text().replace("../../agents", str(ROOT / "agents"))
    new = tmp_path / "other.yaml"
    new.write_text(text.replace("tree: watch($where)", "tree: {ForceSuccess: watch(dock_1)}"))
    refused = team.command("revise", str(new))
    assert refused.returncode == 1
    assert "would be cancelled" in refused.stderr
    new.write_text(text.replace("    tree: watch($where)\n", "").replace("  inspect:\n", ""))
    assert team.command("revise", str(new)).returncode == 2
    assert "revision 1 is in force" in team.mrbt("revise", str(DELIVERIES))
