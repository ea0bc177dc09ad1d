"""Teams over QUIC on loopback: kills, joins, and who holds another key."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.launcher import free_endpoints
from tests.support.team import EXPLORE, REPAIR, Team

pytestmark = pytest.mark.slow


def test_a_killed_robot_is_replaced_and_comes_back(team: Team) -> None:
    """QUIC tells nobody of a death: it is noticed by missing beats alone."""
    team.hold("replace_hw")
    team.up(REPAIR, "--transport", "wireless")
    begun = team.wait_for_work(team.wait_for_event("replace_hw", args=["2"]))
    team.signal(begun["robot"], signal.SIGKILL)
    team.wait_for_work(team.wait_for_replacement(begun))
    team.mrbt("join", begun["robot"])
    team.wait_for_line(f"{begun['robot']} is back")
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    assert [t["robot"] for t in summary["takeovers"]] == [begun["robot"]]
    assert summary["robots"][begun["robot"]]["state"] == "alive"


def test_robots_with_different_keys_never_meet(team: Team, tmp_path: Path) -> None:
    """Each does the whole mission alone, though one dials the other all the time."""
    first, second = free_endpoints(2, "quic")
    agents = []
    for robot, listen, connect in (("R1", first, ()), ("R2", second, ("--connect", first))):
        keys = tmp_path / robot  # a team of its own
        KeyFolder.create(keys, dict.fromkeys(["R1", "R2"], Role.ROBOT))
        options = ["--transport", "wireless", "--keys", str(keys), "--listen", listen, *connect]
        options += ["--team", "keys", "--speed", "10", "--join-timeout", "0", "--exit-when-done"]
        agents.append(team.agent(EXPLORE, robot, *options))
    for agent in agents:
        _, told = agent.communicate()
        assert agent.returncode == 0, told
        assert told.count("local_task_finished") == 2
        assert "] robot_heard " not in told
        assert "] no_other_robot_heard " in told
