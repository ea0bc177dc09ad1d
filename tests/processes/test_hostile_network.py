"""Real Zenoh input that no robot of this project would send, and exits that must not hang."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

from mrbt_mesh.drills.physical import spans
from tests.processes.conftest import REPAIR, ROOT, Team
from tests.support.account import check_paper

pytestmark = [pytest.mark.processes, pytest.mark.timeout(240)]

# Runs in a process of its own: a Zenoh session in the tests' process would outlive them.
STRANGER = """
import json, os, sys, zenoh
team, endpoints = sys.argv[1], sys.argv[2:]
config = zenoh.Config()
config.insert_json5("mode", '"peer"')
config.insert_json5("connect/endpoints", json.dumps(endpoints))
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/gossip/enabled", "false")
session = zenoh.open(config)
noise = [b"", b"noise", b"\\xc1" * 100, b"\\x97" + b"\\x01" * 6, b"\\x91" * 2000, b"x" * (5 << 20)]
tokens = [
    session.liveliness().declare_token(f"mrbt/{team}/alive/{name}")
    for name in ("A1/1/cafe/0", "A1/x/y/z", "A1", "Z9/99999999999999999999/n/0")
]
for round in range(20):
    for data in noise:
        for robot in ("A1", "C2", "Z9", "not%a%robot"):
            session.put(f"mrbt/{team}/beat/{robot}", data)
            session.put(f"mrbt/{team}/fact/{robot}", data)
for data in noise[:5]:
    for robot in ("A1", "C2"):
        for kind in ("pull", "command"):
            list(session.get(f"mrbt/{team}/{kind}/{robot}", payload=data, timeout=2.0))
for token in tokens:
    token.undeclare()
sys.stdout.write("done")
sys.stdout.flush()
os._exit(0)
"""


def test_noise_is_counted_logged_once_per_source_and_changes_nothing(team: Team) -> None:
    team.up(REPAIR, "--speed", "2")
    team.wait_for_event("use_screwdriver", robot="C1")
    info = json.loads((team.run_dir / "run.json").read_text())
    command = [sys.executable, "-c", STRANGER, info["team"], *info["endpoints"].values()]
    told = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert told.stdout == "done"
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["faults"] == summary["takeovers"] == []
    assert set(summary["robots"]) == set(team.robots())
    check_paper(spans(team.events()))
    for robot in team.robots():
        refused = [
            (line["source"], line["reason"])
            for line in team.log(robot)
            if line["event"] == "input_refused"
        ]
        assert {source for source, _ in refused} >= {"A1", "C2", "Z9"}
        assert len(refused) == len(set(refused)), "a reason was logged twice"


def test_a_robot_without_any_peer_stops_at_once_when_told(team: Team) -> None:
    """Closing an isolated Zenoh session takes 10 s; the process must not wait for it."""
    team.run_dir.mkdir()
    mission = ROOT / "examples" / "explore" / "mission.yaml"
    options = ["--listen", "tcp/127.0.0.1:0", "--run-dir", str(team.run_dir)]
    lonely = team.agent(mission, "R1", *options)
    team.wait_for_event("explore", robot="R1")
    lonely.send_signal(signal.SIGTERM)
    assert lonely.wait(timeout=8) == 0
    assert team.events()[-1]["event"] == "cancel"
    assert team.log("R1")[-1]["reason"] == "left"
