"""A team of real processes in monitors of BehaviorTree.CPP."""

from __future__ import annotations

import json
import signal
from xml.etree import ElementTree

import msgpack

from tests.support.groot2 import monitoring
from tests.support.team import EXPLORE, Team

RUNNING, SUCCESS = 1, 2


def listening_on(process: object) -> int:
    """The port of `mrbt watch --groot2 --json`, once it has said it."""
    text = ""
    while not text.endswith("}\n"):
        line = process.stdout.readline()  # type: ignore[attr-defined]
        assert line, text
        text += line
    return int(json.loads(text)["groot2"].rpartition(":")[2])


def test_monitors_tell_what_the_team_does(team: Team) -> None:
    team.hold("R1", "R2")
    team.up(EXPLORE)
    team.wait_for_event("explore")
    where = ("--run-dir", str(team.run_dir), "--port", "0", "--json")
    words = ("watch", "--groot2", *where)
    whole, one = team.start(*words), team.start(*words, "--robot", "R1")
    with monitoring(listening_on(whole)) as monitor, monitoring(listening_on(one)) as robot:
        (xml,) = monitor.ask("T")
        uids = {
            e.get("name"): int(e.attrib["_uid"])
            for e in ElementTree.fromstring(xml).iter()
            if "_uid" in e.attrib
        }
        first, root = uids["explore_area(A)"], 1
        team.wait_until(lambda: monitor.statuses()[first] == RUNNING, "the task runs")
        # T_i runs, with T_A, T_G and T_Li below it.
        team.wait_until(lambda: robot.statuses()[1] == RUNNING, "the robot runs")
        (board,) = monitor.ask("B", b"MainTree")
        assert isinstance(msgpack.unpackb(board)["MainTree"], dict)
        team.release()
        assert team.end()[0] == 0
        # The team is gone; what became of it is still shown.
        team.wait_until(lambda: monitor.statuses()[root] == SUCCESS, "the mission has succeeded")
    for process in (whole, one):
        process.send_signal(signal.SIGINT)
        _, problems = process.communicate(timeout=60)
        assert (process.returncode, problems) == (0, "")


def test_what_cannot_be_shown_is_said(team: Team) -> None:
    done = team.command("watch", "--groot2", "--mission", str(EXPLORE), "--robot", "X")
    assert (done.returncode, done.stdout) == (2, "")
    assert "mission explore has no robot 'X' (it has R1, R2)" in done.stderr
    assert "Traceback" not in done.stderr
