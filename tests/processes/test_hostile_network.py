"""Noise on a team's network, and a robot that is alone on it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

from mrbt_mesh.drills.physical import spans
from tests.support.paper_run import check_paper, go_on_as_in_the_paper, hold_for_the_paper
from tests.support.team import EXPLORE, Team

# Runs in a process of its own: a Zenoh session in the tests' process would outlive them. It makes
# noise until its input ends.
STRANGER = """
import json, os, sys, threading, zenoh
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
enough = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), enough.set()), daemon=True).start()
while not enough.wait(0.1):
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


def _refused(team: Team, robot: str) -> list[tuple[str, str]]:
    """(source, reason) of the inputs that a robot has logged as refused."""
    lines = [line for line in team.log(robot) if line["event"] == "input_refused"]
    return [(line["source"], line["reason"]) for line in lines]


def test_noise_is_counted_logged_once_per_source_and_changes_nothing(team: Team) -> None:
    hold_for_the_paper(team)
    team.up()
    team.wait_for_events(2, "use_screwdriver")
    info = json.loads((team.run_dir / "run.json").read_text())
    stranger = subprocess.Popen(
        [sys.executable, "-c", STRANGER, info["options"]["team"], *info["endpoints"].values()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        team.wait_until(
            lambda: all(
                {source for source, _ in _refused(team, robot)} >= {"A1", "C2", "Z9"}
                for robot in team.robots()
            ),
            "every robot refuses the noise",
        )
        told, _ = stranger.communicate()
    finally:
        stranger.kill()
    assert told == "done"
    go_on_as_in_the_paper(team)
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["faults"] == summary["takeovers"] == []
    assert set(summary["robots"]) == set(team.robots())
    check_paper(spans(team.events()))
    for robot in team.robots():
        refused = _refused(team, robot)
        assert len(refused) == len(set(refused)), "a reason was logged twice"


def test_a_robot_without_any_peer_stops_when_told(team: Team) -> None:
    """Closing an isolated Zenoh session takes 10 s; a robot does not wait for it."""
    team.run_dir.mkdir()
    team.hold("explore")
    options = ["--listen", "tcp/127.0.0.1:0", "--run-dir", str(team.run_dir), "--expect", "R1"]
    lonely = team.agent(EXPLORE, "R1", *options)
    team.wait_for_event("explore", robot="R1")
    lonely.send_signal(signal.SIGTERM)
    assert lonely.wait() == 0
    assert team.events()[-1]["event"] == "cancel"
    assert team.log("R1")[-1]["reason"] == "left"
