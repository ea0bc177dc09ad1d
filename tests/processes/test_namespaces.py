"""Real namespaces: what is cut is cut one way, everything is tidied up, also after a crash."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mrbt_mesh.drills import namespaces
from mrbt_mesh.drills.namespaces import Namespaces
from mrbt_mesh.runtime.launcher import wait_for_exit

_REASON = namespaces.available()
pytestmark = pytest.mark.skipif(_REASON is not None, reason=f"no namespaces: {_REASON}")

PORT = 9_000
COUNT = 400
# Tells its port is open, counts datagrams per sender until one says "end".
RECEIVER = f"""
import collections, socket, sys
found = collections.Counter()
receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
receiver.bind(("0.0.0.0", {PORT}))
print("open", flush=True)
while True:
    data, (sender, _) = receiver.recvfrom(64)
    if data == b"end":
        break
    found[sender] += 1
for sender, count in found.items():
    print(sender, count)
"""
SENDER = f"""
import socket, sys, time
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for number in range({COUNT}):
    sender.sendto(sys.argv[2].encode(), (sys.argv[1], {PORT}))
    if number % 50 == 0:
        time.sleep(0.002)
"""


@pytest.fixture
def space() -> Iterator[Namespaces]:
    with Namespaces(["A1", "B1", "C1"], "test") as made:
        yield made


def received(space: Namespaces, target: str) -> dict[str, int]:
    """How many of 400 datagrams of each other robot, and of the observer, reach the target."""
    receiver = subprocess.Popen(
        [*space.command_prefix(target), sys.executable, "-c", RECEIVER],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert receiver.stdout is not None
    assert receiver.stdout.readline() == "open\n"
    sources = {r: space.command_prefix(r) for r in ("A1", "B1", "C1") if r != target}
    for prefix in (*sources.values(), []):
        command = [*prefix, sys.executable, "-c", SENDER, space.address(target), "x"]
        subprocess.run(command, check=True)
    subprocess.run([sys.executable, "-c", SENDER, space.address(target), "end"], check=True)
    output, _ = receiver.communicate(timeout=30)
    counts = dict(line.split() for line in output.splitlines())
    found = {robot: int(counts.get(space.address(robot), 0)) for robot in sources}
    return found | {"observer": int(counts.get(space.observer_address, 0))}


def test_cuts_and_losses_have_a_direction_and_heal(space: Namespaces) -> None:
    space.disturb([("B1", "A1")], blocked=True)
    space.disturb([("C1", "A1")], loss_permille=500)
    at_a = received(space, "A1")
    assert at_a["B1"] == 0
    assert COUNT // 4 < at_a["C1"] < 3 * COUNT // 4, "about half of them, six sigma and more"
    assert at_a["observer"] == COUNT
    assert received(space, "B1") == {"A1": COUNT, "C1": COUNT, "observer": COUNT}
    space.heal()
    assert received(space, "A1") == {"B1": COUNT, "C1": COUNT, "observer": COUNT}


def test_a_partition_separates_its_groups_both_ways_and_nobody_else(space: Namespaces) -> None:
    space.partition(["A1"], ["B1", "C1"])
    assert received(space, "A1") == {"B1": 0, "C1": 0, "observer": COUNT}
    assert received(space, "B1") == {"A1": 0, "C1": COUNT, "observer": COUNT}
    space.disturb([("A1", "B1")], blocked=False)
    assert received(space, "B1") == {"A1": COUNT, "C1": COUNT, "observer": COUNT}


def traces() -> str:
    """All namespaces and interfaces of this project on the machine."""
    commands = (["ip", "netns"], ["ip", "-brief", "link"])
    listed = [
        subprocess.run(c, capture_output=True, text=True, check=True).stdout for c in commands
    ]
    return "\n".join(line for line in "".join(listed).splitlines() if line.startswith("mrbt"))


def test_nothing_is_left_behind(space: Namespaces) -> None:
    with Namespaces(["A1"], "short") as short:
        mine = short.command_prefix("A1")[3]
        lingering = subprocess.Popen(
            [*short.command_prefix("A1"), "sleep", "1000"], stdout=subprocess.DEVNULL
        )
        assert mine in traces()
    assert lingering.wait(timeout=10) == -signal.SIGKILL
    assert mine not in traces()
    assert space.command_prefix("A1")[3] in traces(), "the other one's must stay"


CRASHING = """
import subprocess
from mrbt_mesh.drills.namespaces import Namespaces
with Namespaces(["A1", "B1"], "crashing") as space:
    command = [*space.command_prefix("A1"), "sleep", "1000"]
    left = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    print(left.pid, flush=True)
    input()
"""


def test_what_a_crashed_runner_left_is_removed_at_the_next_start() -> None:
    runner = subprocess.Popen(
        [sys.executable, "-c", CRASHING],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert runner.stdout is not None
    left = int(runner.stdout.readline())
    runner.kill()
    runner.communicate()
    assert f"mrbt-{runner.pid}-" in traces()
    with Namespaces(["A1"], "next"):
        assert f"mrbt-{runner.pid}-" not in traces()
    wait_for_exit(left)
