"""Keys that change while a team is at work: members get others, or none any more."""

from __future__ import annotations

import json
import shutil

import pytest

from tests.support.raw_intruder import INSIDER
from tests.support.sessions import intruder
from tests.support.team import Team

GONE = "its key has been revoked or replaced"


def stops(team: Team, robot: str) -> int:
    """How often a robot has stopped because of its key."""
    return [line.get("reason") for line in team.log(robot)].count(GONE)


@pytest.mark.slow
def test_a_robot_with_another_key_is_taken_in_again_and_a_revoked_one_is_refused(
    team: Team,
) -> None:
    team.hold("use_screwdriver")
    team.up()
    team.wait_for_events(2, "use_screwdriver")
    keys, stolen = team.run_dir / "keys", team.folder / "stolen"
    shutil.copytree(keys, stolen)

    team.mrbt("keys", "add", "B2", "--replace", "--keys", str(keys))
    team.wait_until(lambda: stops(team, "B2") == 1, "B2 stops")
    assert "B2 joined" in team.mrbt("join", "B2")
    team.wait_for_line("B2 is back")  # `mrbt up` has taken the new manifest over, too

    team.mrbt("keys", "revoke", INSIDER, "--keys", str(keys))
    team.wait_until(lambda: stops(team, INSIDER) == 1, f"{INSIDER} stops")
    refused = team.command("join", INSIDER)
    assert refused.returncode == 2
    assert f"{INSIDER} is not a member of the team" in refused.stderr
    info = json.loads((team.run_dir / "run.json").read_text())
    wanted = {"how": ["member"], "team": info["options"]["team"], "keys": str(stolen)}
    with intruder(**wanted, endpoints=list(info["endpoints"].values())):
        text = f"{INSIDER}: '{INSIDER}' has no key in this team"
        team.wait_until(
            lambda: sum(text in counts for counts in team.status()["refused"].values()) == 5,
            "all others refuse whoever holds the revoked key",
        )
        team.release()
        code, summary = team.end()
    assert code == 0, team.logs()
    states = {robot: row["state"] for robot, row in summary["robots"].items()}
    assert states.pop(INSIDER) != "alive"
    assert set(states.values()) == {"alive"}
    assert sorted(fault["robot"] for fault in summary["faults"]) == [INSIDER, "B2"]
