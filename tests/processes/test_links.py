"""Zenoh's defects, provoked in network namespaces, over both transport profiles."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.drills import namespaces
from mrbt_mesh.drills.namespaces import Namespaces
from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.launcher import agent_arguments, agent_command, ensure_keys
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import Place, RunDir
from mrbt_mesh.runtime.team import new_run
from tests.support.paths import ROOT
from tests.support.team import EXPLORE, Team

_REASON = namespaces.available()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(_REASON is not None, reason=f"no namespaces: {_REASON}"),
]

AGENT = [sys.executable, "-m", "mrbt_mesh", "agent"]
PROFILES = ("wired", "wireless")
AT_REST = """\
mission: at_rest
program: robot.py
local_tasks: {wait: {work: 1}}
conditions: {wanted: {default: false}}
robot_types: {R: {capabilities: {wait: 1}}}
robots: {R1: R, R2: R, R3: R, R4: R}
global_tasks: {work: {needs: {wait: {min: 1}}}}
tree:
  KeepRunningUntilFailure:
    Fallback:
      - Inverter: {Condition: wanted}
      - work
"""
PROGRAM = """\
from mrbt_mesh import RobotProgram
robot = RobotProgram()
@robot.local_task("wait")
async def wait(): pass
"""


class Crew:
    """A team at rest, each robot in its namespace. `dials`: who connects to whom, if not usual."""

    def __init__(self, team: Team, space: Namespaces, profile: str, robots: Sequence[str]) -> None:
        mission_path = team.folder / "mission.yaml"
        mission_path.write_text(AT_REST)
        (team.folder / "robot.py").write_text(PROGRAM)
        mission = load_mission(mission_path)
        assert mission.program is not None
        self.team, self.space, self.robots = team, space, robots
        self.info = new_run(
            mission,
            mission_path,
            robots,
            RobotOptions(program=mission.program, transport=profile),
            places={r: Place(space.address(r), tuple(space.command_prefix(r))) for r in robots},
        )
        self.run_dir = RunDir.create(team.run_dir, self.info, compile_mission(mission))
        ensure_keys(self.run_dir, self.info, robots[0])
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self) -> None:
        for robot in self.robots:
            arguments = agent_arguments(self.run_dir, self.info, robot)
            command = agent_command(self.info, robot, arguments)
            self.processes[robot] = subprocess.Popen(command, env=self.team.environment)
        self.wait(lambda: all(self.hears(r) for r in self.robots), "everybody hears everybody")

    def hears(self, robot: str) -> bool:
        log = self.team.log(robot)
        heard = {line["peer"] for line in log if line["event"] == "link_up"}
        return heard == {*self.robots} - {robot} and any(line["event"] == "joined" for line in log)

    def wait(self, holds: Callable[[], Any], what: str) -> Any:
        return self.team.wait_until(holds, what)

    def silent_links(self) -> set[tuple[str, str]]:
        """(robot, peer) where the robot has last said that it does not hear the peer."""
        found = set()
        for robot in self.robots:
            for line in self.team.log(robot):
                if line["event"] == "link_silent":
                    found.add((robot, line["peer"]))
                elif line["event"] == "link_heard":
                    found.discard((robot, line["peer"]))
        return found

    def cut_one_sided(self, source: str, target: str) -> None:
        """The target's lease expires, and the source cannot be told; then all is well again."""
        pause = threading.Event()
        self.space.disturb([(source, target)], blocked=True)
        pause.wait(1.0)
        self.space.disturb([(target, source)], blocked=True)
        pause.wait(1.5)
        self.space.heal()


@contextmanager
def crew(team: Team, profile: str, robots: Sequence[str]) -> Iterator[Crew]:
    made = None
    try:
        with Namespaces(robots, "links") as space:
            made = Crew(team, space, profile, robots)
            yield made
    finally:
        # Their namespaces are gone, and they with them.
        for process in made.processes.values() if made else ():
            process.wait()


def test_a_session_split_for_good_is_reopened(team: Team) -> None:
    """What single dialling avoids is provoked by mutual dialling; the runtime repairs it."""
    robots = ("R1", "R2", "R3", "R4")
    with crew(team, "wireless", robots) as mutual:
        dials = {r: [other for other in robots if other != r] for r in robots}
        mutual.info = replace(mutual.info, dials=dials)
        mutual.start()

        def split() -> list[tuple[str, str]]:
            return [
                (robot, line["peer"])
                for robot in robots
                for line in team.log(robot)
                if line["event"] == "session_split"
            ]

        for _ in range(10):
            for pair in (("R1", "R2"), ("R3", "R4"), ("R2", "R3")):
                mutual.cut_one_sided(*pair)
            # Either it comes back by itself, or only a new session helps.
            mutual.wait(lambda: split() or not mutual.silent_links(), "links or a split")
            if split():
                break
        assert split(), "no cut has split a session"
        mutual.wait(lambda: not mutual.silent_links(), "every link is heard again")
        assert all(process.poll() is None for process in mutual.processes.values()), team.logs()


@pytest.mark.parametrize("profile", PROFILES)
def test_an_isolated_robot_stops_when_told(team: Team, profile: str) -> None:
    """Closing a session with dead links may take 10 s; the process does not wait for it."""
    with crew(team, profile, ("R1", "R2", "R3")) as three:
        three.start()
        three.space.partition(["R2"], ["R1", "R3"])
        three.processes["R2"].send_signal(signal.SIGTERM)
        assert three.processes["R2"].wait() == 0
        assert team.log("R2")[-1]["reason"] == "left"


@pytest.mark.parametrize("profile", PROFILES)
def test_robots_on_one_network_need_only_mission_team_and_id(
    team: Team, tmp_path: Path, profile: str
) -> None:
    """As on several machines: found by multicast, no launcher, no run directory, no endpoint."""
    options = ["--mission", str(EXPLORE), "--team", "found", "--speed", "10", "--exit-when-done"]
    team.hold("explore")
    if profile == "wireless":
        KeyFolder.create(tmp_path / "keys", dict.fromkeys(["R1", "R2"], Role.ROBOT))
        options += ["--transport", "wireless", "--keys", str(tmp_path / "keys")]
    else:
        options.append("--insecure")
    said = {robot: tmp_path / f"{robot}.err" for robot in ("R1", "R2")}
    with Namespaces(["R1", "R2"], "multicast") as space:
        started = []
        for robot, path in said.items():
            with path.open("w") as output:
                command = [*space.command_prefix(robot), *AGENT, *options, "--robot", robot]
                environment = team.environment | {"PYTHONPATH": str(ROOT)}
                started.append(subprocess.Popen(command, env=environment, stderr=output))
        team.wait_until(
            lambda: all("local_task_started" in path.read_text() for path in said.values()),
            "both are at work",
        )
        team.release()
        codes = [process.wait() for process in started]
    told = {robot: path.read_text() for robot, path in said.items()}
    assert codes == [0, 0], told
    for text in told.values():
        assert "robot_heard" in text, "the other one was never found"
        assert text.count("local_task_finished") == 1, told
