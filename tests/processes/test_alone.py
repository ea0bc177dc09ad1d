"""Robots that do not hear each other say so, before they do what others may do too.

Each has a network namespace of its own. They find each other by multicast, or by an address.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator

import pytest

from mrbt_mesh.drills import namespaces
from mrbt_mesh.drills.namespaces import Namespaces
from mrbt_mesh.drills.physical import read_events
from tests.support.paths import ROOT, mission_file
from tests.support.team import Team

_REASON = namespaces.available()
needs_namespaces = pytest.mark.skipif(_REASON is not None, reason=f"no namespaces: {_REASON}")
EXPLORE = mission_file("explore")
PORT, LOCAL_PORT = 7450, 7451
MRBT = (sys.executable, "-m", "mrbt_mesh")
# A user that no process of this machine belongs to: the limit counts all threads of a user.
NO_USER = 54_321


class Place:
    """Robots by hand, R1 and R2, each at its place in the network."""

    def __init__(self, space: Namespaces, team: Team) -> None:
        self.space = space
        self.team = team
        self.started: list[subprocess.Popen[bytes]] = []

    def run(self, robot: str, *command: str) -> str:
        """Run a command at a robot's place, which must succeed."""
        words = [*self.space.command_prefix(robot), *command]
        environment = self.team.environment
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def start(self, robot: str, *options: str) -> None:
        """Start a robot; what it prints is in a file."""
        words = ["agent", "--insecure", "--mission", str(EXPLORE), "--robot", robot]
        words += ["--run-dir", str(self.team.folder / robot), "--join-timeout", "2", *options]
        with (self.team.folder / f"{robot}.out").open("w") as output:
            process = subprocess.Popen(
                [*self.space.command_prefix(robot), *MRBT, *words],
                env=self.team.environment,
                cwd=ROOT,
                stdout=output,
                stderr=output,
            )
        self.started.append(process)

    def printed(self, robot: str) -> str:
        return (self.team.folder / f"{robot}.out").read_text()

    def wait_for(self, robot: str, text: str) -> None:
        self.team.wait_until(lambda: text in self.printed(robot), f"{robot} prints {text!r}")

    def events(self, robot: str) -> list[str]:
        return [each["event"] for each in read_events(self.team.folder / robot / f"{robot}.log")]

    def wait_for_event(self, robot: str, *names: str) -> list[str]:
        def found() -> list[str] | None:
            events = self.events(robot)
            return events if set(names) <= set(events) else None

        result: list[str] = self.team.wait_until(found, f"{names} in the log of {robot}")
        return result

    def headline(self, robot: str) -> list[str]:
        """That of `mrbt status` at the robot's place."""
        address = f"tcp/127.0.0.1:{LOCAL_PORT}"
        words = ("env", f"MRBT_CONNECT={address}", *MRBT, "status", "--mission", str(EXPLORE))
        data = json.loads(self.run(robot, *words, "--json"))
        return [each["text"] for each in data["headline"]]


@pytest.fixture
def place(team: Team) -> Iterator[Place]:
    with Namespaces(["R1", "R2"], "alone") as space:
        made = Place(space, team)
        yield made
        for process in made.started:
            process.kill()
            process.wait()


@needs_namespaces
def test_robots_that_cannot_hear_each_other_say_so_and_wait(place: Place) -> None:
    block = ("iptables", "-w", "{}", "INPUT", "-d", "224.0.0.0/4", "-j", "DROP")
    endpoints = ("--multicast", "auto", "--listen", f"tcp/0.0.0.0:{LOCAL_PORT}")
    for robot in ("R1", "R2"):
        place.run(robot, *(word.format("-A") for word in block))
        place.start(robot, *endpoints, "--alone-after", "600")
    alone = "no other robot was heard yet, on multicast of auto (eth0); listening on tcp/0.0.0.0"
    for robot in ("R1", "R2"):
        place.wait_for(robot, alone)
        waits = f"{robot} waits: it has heard no other robot (--alone begins at once)"
        place.team.wait_until(lambda w=waits, r=robot: w in place.headline(r)[0], waits)
        assert "joined" not in place.events(robot)
    for robot in ("R1", "R2"):
        place.run(robot, *(word.format("-D") for word in block))
    for robot in ("R1", "R2"):
        place.wait_for_event(robot, "link_up", "joined", "local_task_started")
        assert not any("no other robot" in text for text in place.headline(robot))
        assert place.printed(robot).count("no other robot was heard") == 1


@needs_namespaces
def test_a_robot_that_has_waited_begins_alone_and_status_shows_it(place: Place) -> None:
    place.start("R1", "--listen", f"tcp/127.0.0.1:{LOCAL_PORT}", "--alone-after", "3")
    events = place.wait_for_event("R1", "local_task_started")
    assert events.index("no_other_robot_heard") < events.index("joined")
    assert place.headline("R1")[0].startswith("R1: no other robot was heard yet, on listening on")


@needs_namespaces
def test_an_address_that_goes_away_is_named_and_listened_on_when_it_is_back(place: Place) -> None:
    address = place.space.address("R1")
    ends = ("--listen", f"tcp/{address}:{PORT},tcp/127.0.0.1:{LOCAL_PORT}")
    place.start("R1", *ends)
    place.start("R2", "--connect", f"tcp/{address}:{PORT}")
    for robot in ("R1", "R2"):
        place.wait_for_event(robot, "link_up", "joined")
    there = f"{address}/24"
    place.run("R1", "ip", "address", "del", there, "dev", "eth0")
    place.wait_for(
        "R1", f"it listens on {address}, which is not an address of this machine any more"
    )
    gone = f"R1: it listens on {address}, which is not an address of"
    place.team.wait_until(lambda: any(gone in text for text in place.headline("R1")), gone)
    place.wait_for_event("R2", "link_silent")
    place.run("R1", "ip", "address", "add", there, "dev", "eth0")
    place.wait_for("R1", "the address is back")
    place.wait_for_event("R2", "link_heard")
    assert not any(gone in text for text in place.headline("R1"))


@pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("setpriv") is None or shutil.which("prlimit") is None,
    reason="a limit of threads, which counts those of a user, needs root, setpriv and prlimit",
)
@pytest.mark.parametrize("limit", [4, 8, 12, 20])
def test_a_robot_without_the_threads_of_a_session_ends_and_says_so(limit: int) -> None:
    """Zenoh's session would go on without them, and hear nobody."""
    rights = "-all,+dac_override,+dac_read_search"
    user = ("setpriv", f"--reuid={NO_USER}", f"--regid={NO_USER}", "--clear-groups")
    caps = (f"--{each}={rights}" for each in ("inh-caps", "ambient-caps", "bounding-set"))
    # Relative: access(2) does not mind capabilities, and a clone may lie in a private folder.
    mission = str(EXPLORE.relative_to(ROOT))
    words = ("agent", "--insecure", "--mission", mission, "--robot", "R1", "--alone")
    done = subprocess.run(
        [*user, *caps, "prlimit", f"--nproc={limit}", *MRBT, *words, "--listen", "tcp/127.0.0.1:0"],
        cwd=ROOT,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("mrbt agent: this process can start only ")
    assert "raise the limit of processes (ulimit -u, pids.max" in last
