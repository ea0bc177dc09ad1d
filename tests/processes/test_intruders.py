"""Whoever reaches the robots' ports, has heard all, and says it again changed, is not believed."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from mrbt_mesh.drills.physical import spans
from tests.support.paper_run import check_paper, go_on_as_in_the_paper, hold_for_the_paper
from tests.support.team import EXPLORE, TEST_TIMEOUT_S, Team

pytestmark = [pytest.mark.processes, pytest.mark.timeout(TEST_TIMEOUT_S)]

# Runs in a process of its own, like the stranger of test_hostile_network. It hears everything, and
# says it again in the way that its first argument names, until its input ends.
INTRUDER = """
import json, os, random, sys, threading, time, zenoh
how, team, endpoints = sys.argv[1], sys.argv[2], sys.argv[3:]
config = zenoh.Config()
config.insert_json5("mode", '"peer"')
config.insert_json5("connect/endpoints", json.dumps(endpoints))
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/gossip/enabled", "false")
session = zenoh.open(config)
heard, lock = [], threading.Lock()
def hear(sample):
    with lock:
        heard.append((str(sample.key_expr), sample.payload.to_bytes()))
        del heard[:-2000]
kept = session.declare_subscriber(f"mrbt/{team}/**", zenoh.handlers.Callback(hear, indirect=False))
enough = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), enough.set()), daemon=True).start()
dice, sent = random.Random(1), 0
def changed(data):
    data = bytearray(data)
    for _ in range(dice.randint(1, 4)):
        data[dice.randrange(len(data))] ^= dice.randint(1, 255)
    return bytes(data)
start = time.monotonic()
while not enough.wait(0.005):
    with lock:
        known = list(heard)
    if not known:
        continue
    count = 25 if how != "flood" else max(0, int((time.monotonic() - start) * 20000) - sent)
    for _ in range(min(count, 2000)):
        key, data = dice.choice(known)
        session.put(key, data if how == "again" else changed(data))
        sent += 1
if how == "order":
    for robot in ("A1", "C2"):
        list(session.get(f"mrbt/{team}/command/{robot}", payload=known[0][1], timeout=2.0))
sys.stdout.write(str(sent))
sys.stdout.flush()
os._exit(0)
"""


@contextmanager
def intruder(team: Team, how: str) -> Iterator[subprocess.Popen[str]]:
    info = json.loads((team.run_dir / "run.json").read_text())
    process = subprocess.Popen(
        [sys.executable, "-c", INTRUDER, how, info["team"], *info["endpoints"].values()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def refusals(team: Team) -> set[str]:
    """The reasons that `mrbt status` shows, of all robots."""
    rows = team.status()["refused"].values()
    return {text.partition(": ")[2] for counts in rows for text in counts}


@pytest.mark.parametrize(
    ("how", "reason"), [("changed", "signature is wrong"), ("again", "said before")]
)
def test_a_repair_succeeds_among_messages_that_were_heard_and_come_again(
    team: Team, how: str, reason: str
) -> None:
    hold_for_the_paper(team)
    team.up()
    team.wait_for_events(2, "use_screwdriver")
    with intruder(team, how) as process:
        team.wait_until(lambda: reason in refusals(team), "status shows what was refused")
        go_on_as_in_the_paper(team)
        code, summary = team.end()
        told, _ = process.communicate()
    assert code == 0, team.logs()
    assert int(told) > 0
    assert summary["faults"] == summary["takeovers"] == []
    check_paper(spans(team.events()))


def test_an_order_without_the_operators_key_is_refused_and_told_so(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    info = json.loads((team.run_dir / "run.json").read_text())
    where = ["--mission", str(team.run_dir / "mission.json"), "--team", info["team"]]
    where += ["--run", info["run"], "--beat", str(info["beat_s"])]
    for endpoint in info["endpoints"].values():
        where += ["--connect", endpoint]
    done = team.command("abort", *where)
    assert done.returncode == 1
    assert "signed: this team has keys" in done.stderr
    operator = team.run_dir / "keys" / "operator.key"
    key = operator.read_text()
    operator.unlink()
    team.mrbt("keys", "add", "screen", "--role", "observer", "--keys", str(team.run_dir / "keys"))
    seen = team.status()
    assert seen["secure"] is True
    refused = team.command("abort")
    assert refused.returncode == 1
    assert "screen is known as observer and may not say this" in refused.stderr
    operator.write_text(key)
    assert "abort is the team's order" in team.mrbt("abort")
    code, _ = team.end()
    assert code == 1, team.logs()
