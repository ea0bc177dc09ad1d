"""A team whose robots are action servers of rclpy: what was driven is what the servers say.
`make test-ros2` gets what this needs.
"""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.command import mrbt
from tests.support.ros2.virtual_robots import VirtualRobots, lacking
from tests.support.team import Team

pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(lacking()), reason=lacking())]

# How long it took: `pytest --log-cli-level=info`.
LOG = logging.getLogger(__name__)
ROBOTS = ("A1", "A2", "A3")
PLACES = [[4.0, 0.0], [0.0, 4.0], [-4.0, 0.0], [0.0, -4.0]]


@pytest.fixture
def robots(tmp_path: Path) -> Iterator[VirtualRobots]:
    """A domain without robots."""
    with VirtualRobots(tmp_path) as found:
        yield found


def begin(team: Team, robots: VirtualRobots, speed: float = 2.0) -> None:
    """What `mrbt new --ros2` writes, with robots that drive so fast."""
    folder = team.folder / "my_team"
    assert mrbt("new", "--ros2", str(folder))[0] == 0
    script = folder / "virtual_robots.py"
    text = script.read_text()
    assert text.count("SPEED = 2.0") == 1
    script.write_text(text.replace("SPEED = 2.0", f"SPEED = {speed}"))
    robots.use(script)
    robots.start(*ROBOTS)
    team.environment |= robots.environment
    team.up(folder / "mission.yaml")


def place_of(said: dict[str, Any]) -> list[float]:
    return [said["x"], said["y"]]


def ends_well(team: Team, robots: VirtualRobots) -> None:
    """The mission succeeds, all places were reached once, and no bridge is left."""
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["result"] == "success"
    assert sorted(map(place_of, robots.events("end"))) == sorted(PLACES)
    assert len(robots.events("report")) == 1
    psutil.wait_procs(bridges(team), timeout=20)
    assert bridges(team) == []


def bridges(team: Team, robot: str | None = None) -> list[psutil.Process]:
    """The bridges of the team's robots that run."""
    found = []
    for process in psutil.process_iter(["cmdline", "environ"]):
        words = process.info["cmdline"] or []
        environment = process.info["environ"] or {}
        if any(word.endswith("adapters/ros2/bridge") for word in words) and (
            environment.get("MRBT_STATE_DIR") == str(team.folder)
        ):
            found.append(process)
    if robot is not None:
        pid = team.pid(robot)
        return [process for process in found if process.ppid() == pid]
    return found


def capabilities(team: Team, robot: str, event: str) -> list[dict[str, Any]]:
    return [line for line in team.log(robot) if line.get("event") == event]


def test_three_robots_patrol_and_one_reports(team: Team, robots: VirtualRobots) -> None:
    begin(team, robots)
    ends_well(team, robots)
    assert robots.events("cancelled") == robots.events("aborted") == []
    # A robot that is ready late finds less to do.
    assert len({each["robot"] for each in robots.events("end")}) > 1


def test_a_server_that_is_killed_is_noticed_and_its_robot_replaced(
    team: Team, robots: VirtualRobots
) -> None:
    begin(team, robots, speed=0.5)
    began = robots.wait_for(lambda said: said["event"] == "start")
    team.wait_until(
        lambda: len(capabilities(team, began["robot"], "server_found")) == 2, "both are found"
    )
    killed_s = robots.kill(began["robot"])
    # Of all that its process served the robot says that it is lost.
    lost = team.wait_until(
        lambda: len(found := capabilities(team, began["robot"], "server_lost")) >= 2 and found,
        "the loss is noticed",
    )
    assert {line["local_task"] for line in lost} == {"go_to", "report"}
    instead = robots.wait_for(
        lambda said: (
            said["event"] == "start"
            and said["robot"] != began["robot"]
            and place_of(said) == place_of(began)
        )
    )
    # It comes back while the others drive, and is of use again.
    robots.start(began["robot"])
    team.wait_until(
        lambda: len(capabilities(team, began["robot"], "server_found")) >= 4, "it is found again"
    )
    noticed_s = datetime.fromisoformat(lost[0]["timestamp"]).timestamp() - killed_s
    LOG.info("server: lost %.2f s, other %.2f s", noticed_s, instead["t"] - killed_s)
    ends_well(team, robots)


def test_the_goal_of_a_robot_that_is_killed_is_cancelled_and_another_drives(
    team: Team, robots: VirtualRobots
) -> None:
    begin(team, robots, speed=0.5)
    began = robots.wait_for(lambda said: said["event"] == "start")
    killed = bridges(team, began["robot"])
    assert len(killed) == 1
    team.signal(began["robot"], signal.SIGKILL)
    killed_s, count = time.time(), len(robots.said)
    stopped = robots.wait_for(
        lambda said: said["event"] == "cancelled" and said["robot"] == began["robot"]
    )
    instead = robots.wait_for(
        lambda said: said["event"] == "start" and place_of(said) == place_of(began), count
    )
    assert instead["robot"] != began["robot"]
    # Its bridge has ended with it.
    assert psutil.wait_procs(killed, timeout=30)[1] == []
    LOG.info("robot: stop %.2f s, other %.2f s", stopped["t"] - killed_s, instead["t"] - killed_s)
    ends_well(team, robots)


def test_the_goal_of_a_robot_that_is_frozen_is_cancelled(team: Team, robots: VirtualRobots) -> None:
    begin(team, robots, speed=0.5)
    began = robots.wait_for(lambda said: said["event"] == "start")
    team.signal(began["robot"], signal.SIGSTOP)
    frozen_s = time.time()
    stopped = robots.wait_for(
        lambda said: said["event"] == "cancelled" and said["robot"] == began["robot"]
    )
    instead = robots.wait_for(
        lambda said: (
            said["event"] == "start"
            and said["robot"] != began["robot"]
            and place_of(said) == place_of(began)
        )
    )
    LOG.info("frozen: stop %.2f s, other %.2f s", stopped["t"] - frozen_s, instead["t"] - frozen_s)
    team.signal(began["robot"], signal.SIGCONT)
    ends_well(team, robots)


def test_the_goal_of_a_bridge_that_is_killed_is_cancelled_by_the_next(
    team: Team, robots: VirtualRobots
) -> None:
    begin(team, robots, speed=0.5)
    began = robots.wait_for(lambda said: said["event"] == "start")
    [bridge] = bridges(team, began["robot"])
    bridge.kill()
    robots.wait_for(lambda said: said["event"] == "cancelled" and said["robot"] == began["robot"])
    ends_well(team, robots)


def test_a_wrong_binding_is_told_with_its_line(team: Team, tmp_path: Path) -> None:
    folder = tmp_path / "my_team"
    assert mrbt("new", "--ros2", str(folder))[0] == 0
    file = folder / "ros2.yaml"
    text = file.read_text()
    changes = {
        "position: {x:": "positon: {x:",
        "m.distance_remaining": "m.distance_left",
        "std_srvs/srv/Trigger": "std_srvs/srv/Triger",
        "x: $place.x, y:": "x: $place.x, y_:",
    }
    for old, new in changes.items():
        assert text.count(old) == 1, old
        file.write_text(text.replace(old, new))
        line = text[: text.index(old)].count("\n") + 1
        done = team.command("up", str(folder / "mission.yaml"), "--headless")
        said = done.stderr.replace("\n", "")
        assert done.returncode == 2, said
        assert f"ros2.yaml:{line}:" in said
        assert "did you mean" in said, said
