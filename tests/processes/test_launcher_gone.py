"""What becomes of robots whose launcher is gone: they leave by themselves."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import psutil
import pytest

from tests.support.team import EXPLORE, WAIT_S, Team

IN_ORDER = ["launcher_gone", "leaving", "stopped"]


def end_of(team: Team, robot: str) -> list[str]:
    """What a robot's log says of its end."""
    return [line["event"] for line in team.log(robot) if line["event"] in IN_ORDER]


def wait_for_exits(team: Team, processes: list[psutil.Process]) -> None:
    _, alive = psutil.wait_procs(processes, timeout=WAIT_S)
    assert alive == [], team.logs()


@pytest.fixture
def closable_terminal() -> Iterator[None]:
    """What is started hears of a closed terminal, also where the tests themselves must not."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_robots_leave_in_order_when_their_launcher_is_gone(
    team: Team, number: signal.Signals, closable_terminal: None
) -> None:
    """Also one that joined meanwhile, by a command that has long ended."""
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    team.mrbt("join", "R3", "--type", "explorer")
    found = team.running() + team.fork_servers()
    assert len(found) == 4
    team.signal_launcher(number)
    wait_for_exits(team, found)
    assert [end_of(team, robot) for robot in ("R1", "R2", "R3")] == [IN_ORDER] * 3, team.logs()
    cancelled = {line["robot"] for line in team.events() if line["event"] == "cancel"}
    assert cancelled >= {"R1", "R2"}


def test_a_robot_whose_program_blocks_it_ends_too(team: Team) -> None:
    program = team.folder / "robot.py"
    program.write_text(
        "import sys, threading\nfrom mrbt_mesh import RobotProgram\nrobot = RobotProgram()\n"
        "@robot.local_task('explore')\nasync def explore(area): ...\n"
        "if 'agent' in sys.argv:\n    threading.Event().wait()\n"
    )
    team.up(EXPLORE, "--program", str(program))
    team.wait_until(lambda: len(team.robots()) == 2, "both robots have started")
    found = team.running()
    assert len(found) == 2
    team.signal_launcher(signal.SIGKILL)
    wait_for_exits(team, found)


def test_robots_of_a_drill_leave_too(team: Team) -> None:
    drill = team.folder / "drill.yaml"
    drill.write_text(
        f"name: too_slow\ndescription: It takes for ever.\nmission: {EXPLORE}\nspeed: 0.01\n"
        "expect: {result: success}\n"
    )
    drilling = team.start("drill", str(drill))
    team.wait_until(lambda: len(team.running()) == 2, "both robots have started")
    found = team.running()
    drilling.kill()
    wait_for_exits(team, found)
