"""Commands and refusals on real processes: identity, foreign teams, detaching, own robots."""

from __future__ import annotations

import getpass
import json
import socket

import pytest

from mrbt_mesh.runtime.run_dir import COMMANDS_FILE
from tests.support.team import EXPLORE, Team


def endpoints(team: Team) -> list[str]:
    """Options that make an agent dial everybody of the running team."""
    info = json.loads((team.run_dir / "run.json").read_text())
    result = [
        "--team",
        info["options"]["team"],
        "--listen",
        "tcp/127.0.0.1:0",
        "--beat",
        str(info["options"]["beat_s"]),
    ]
    for endpoint in info["endpoints"].values():
        result += ["--connect", endpoint]
    keys = team.run_dir / "keys"
    return [*result, "--keys", str(keys)] if keys.exists() else result


def test_a_second_robot_of_the_same_id_is_refused_and_takeover_overrides(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    run = json.loads((team.run_dir / "run.json").read_text())["options"]["run"]
    mission = team.run_dir / "mission.json"
    _, problems = team.agent(mission, "R1", "--run", run, *endpoints(team)).communicate()
    assert "robot R1 is already running" in problems
    assert "--takeover" in problems
    refused = team.command("join", "R1")
    assert refused.returncode == 2
    assert "robot R1 is already running (pid" in refused.stderr
    old = team.pid("R1")
    team.mrbt("join", "R1", "--takeover")
    (stopped,) = team.wait_until(lambda: _stopped(team, "R1"), "the old R1 has stopped")
    assert "another process has taken over the id R1" in stopped["reason"]
    new = team.pid("R1")
    assert new != old
    assert team.status()["robots"]["R1"]["pid"] == new
    team.release()
    code, _ = team.end()
    assert code == 0, team.logs()


@pytest.mark.smoke
def test_detached_teams_run_without_an_observer_and_end_by_themselves(team: Team) -> None:
    told = team.mrbt(
        "up", str(EXPLORE), "--speed", "10", "--detach", "--run-dir", str(team.run_dir)
    )
    assert "2 robots run" in told
    team.wait_for_events(2, "explore", "end")
    assert team.fork_servers() == []
    over = team.wait_until(lambda: _stopped(team, "R1"), "R1 stopped")
    assert over[-1]["reason"] == "mission success"
    summary = team.run_dir / "summary.json"
    team.wait_until(summary.exists, "its summary is written, though nobody watched")
    assert json.loads(summary.read_text())["result"] == "success"
    assert team.status() | {"over": True, "result": "success"} == team.status()
    refused = team.command("join", "R1")
    assert refused.returncode == 2
    assert "the mission is over (success); `mrbt up` begins one anew" in refused.stderr


def test_a_detached_team_that_is_killed_has_a_status(team: Team) -> None:
    team.hold("explore")
    team.mrbt("up", str(EXPLORE), "--detach", "--run-dir", str(team.run_dir))
    team.wait_for_events(2, "explore")
    team.kill_all()
    team.wait_until(lambda: not team.running(), "all are gone")
    assert team.mrbt("status").startswith("the run is over: blocked\n")
    summary = json.loads((team.run_dir / "summary.json").read_text())
    assert (summary["result"], summary["ended_because"]) == ("blocked", "no robot is left")
    assert 0 <= summary["duration_s"] < 100
    assert {row["robots"][0] for row in summary["global_tasks"].values()} == {"R1", "R2"}
    assert {row["state"] for row in summary["robots"].values()} == {"dead"}
    watched = team.command("watch", "--json")
    assert (watched.returncode, json.loads(watched.stdout)) == (3, summary)
    info = team.run_dir / "run.json"
    kept = info.read_text()
    info.write_text(kept.replace(".py", ".no"))
    refused = team.command("join", "R1", "--run-dir", str(team.run_dir))
    assert refused.returncode == 2, refused.stdout
    info.write_text(kept)
    written = team.run_dir / "summary.json"
    team.wait_until(written.exists, "the end is written again, though nobody joined")
    team.release()
    team.mrbt("join", "R1", "--run-dir", str(team.run_dir))
    team.mrbt("join", "R2", "--run-dir", str(team.run_dir))
    over = team.wait_until(lambda: _stopped(team, "R1"), "R1 stopped")
    assert over[-1]["reason"] == "mission success"
    path = team.run_dir / "summary.json"
    team.wait_until(path.exists, "the summary of the second end is written")
    assert json.loads(path.read_text())["result"] == "success"
    assert "contradictions" not in team.mrbt("recording", "verify", str(team.run_dir))


def test_a_detached_team_that_cannot_start_is_said_and_leaves_no_robot(team: Team) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        metrics = ("--metrics-port", str(port))
        options = ("--detach", "--run-dir", str(team.run_dir), *metrics)
        refused = team.command("up", str(EXPLORE), *options)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert f"metrics cannot be served on 127.0.0.1:{port}: Address already" in refused.stderr
    assert team.running() == []


def _stopped(team: Team, robot: str) -> list[dict[str, str]]:
    return [line for line in team.log(robot) if line["event"] == "stopped"]


@pytest.mark.smoke
def test_pause_resume_abort(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    name = json.loads((team.run_dir / "run.json").read_text())["options"]["team"]
    assert team.mrbt("pause").startswith(f"{name}: pause is the team's command")
    team.wait_for_events(2, "explore", "cancel")
    given = json.loads(team.mrbt("resume", "--run-dir", name, "--json"))
    assert given | {"result": ""} == {
        "team": name,
        "robots": ["R1", "R2"],
        "command": "resume",
        "result": "",
    }
    team.wait_for_events(4, "explore")
    team.mrbt("abort")
    code, summary = team.end()
    assert (code, summary["result"]) == (1, "failure")
    assert summary["ended_because"] == "an operator has aborted it"


@pytest.mark.slow
def test_a_robot_that_the_mission_does_not_list_joins_with_its_type(team: Team) -> None:
    team.hold("use_screwdriver", "do_diagnosis")
    team.up()
    team.wait_for_event("use_screwdriver", robot="C1")
    refused = team.command("join", "A3")
    assert refused.returncode == 2
    assert "give its --type (A, B, C)" in refused.stderr
    team.mrbt("join", "A3", "--type", "A")
    team.release("use_screwdriver")
    team.wait_for_event("do_diagnosis", robot="A3")
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["robots"]["A3"]["type"] == "A"


def test_a_run_that_ends_before_its_team_has_gathered_has_not_started(team: Team) -> None:
    """Its robots never get further than their program; only what `up` knows of them is quick."""
    program = team.folder / "robot.py"
    program.write_text(
        "import sys, time\nfrom mrbt_mesh import RobotProgram\nrobot = RobotProgram()\n"
        "@robot.local_task('explore')\nasync def explore(area): ...\n"
        "while 'agent' in sys.argv:\n    time.sleep(0.1)\n"
    )
    options = ["--program", str(program), "--timeout", "1", "--run-dir", str(team.run_dir)]
    done = team.command("up", str(EXPLORE), "--json", *options)
    assert done.returncode == 3
    summary = json.loads(done.stdout)
    assert (summary["result"], summary["ended_because"]) == ("not_started", "time is up")
    assert summary["duration_s"] is None
    assert summary["robots"] == {}
    assert summary == json.loads((team.run_dir / "summary.json").read_text())
    assert team.running() == []


def test_a_run_that_is_stopped_on_its_way_is_not_finished(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_line("R1: explore(A) for explore_area(A)")
    team.interrupt()
    code, summary = team.end()
    assert (code, summary["result"]) == (3, "ended")
    assert summary["ended_because"] == "stopped by the operator"
    assert "mission not finished: an operator has ended it" in team.lines()


def test_a_team_is_ended_by_its_name(team: Team) -> None:
    """As Ctrl-C does where `mrbt up` watches it, else robot by robot, also a frozen one."""
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    name = json.loads((team.run_dir / "run.json").read_text())["options"]["team"]
    expected = f"{name}: 2 robots ended, mission not finished\n"
    assert team.mrbt("down", name) == expected
    assert "mrbt down" in (team.run_dir / COMMANDS_FILE).read_text()
    code, summary = team.end()
    because = f"ended by {getpass.getuser()} (mrbt down)"
    assert (code, summary["result"], summary["ended_because"]) == (3, "ended", because)
    other = team.folder / "other"
    team.mrbt("up", str(EXPLORE), "--detach", "--run-dir", str(other))
    team.mrbt("freeze", "R1")
    ended = json.loads(team.mrbt("down", "--json"))
    assert (ended["command"], ended["robots"]) == ("down", ["R1", "R2"])
    assert ended["team"] != name
    summary = json.loads((other / "summary.json").read_text())
    assert (summary["result"], summary["ended_because"]) == ("ended", because)
    assert team.running() == []


def test_who_watches_late_knows_the_past(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    for event in team.wait_for_events(2, "explore"):
        team.wait_for_work(event)
    team.mrbt("kill", "R2")
    team.wait_for_line("R2 is dead")
    lines = team.command("watch", "--headless", "--timeout", "1").stdout
    assert "R2: explore(B) for explore_area(B)\n" in lines
    assert "R2 is dead\n" in lines


def test_with_two_teams_commands_ask_which_one_is_meant(team: Team) -> None:
    team.hold("explore")
    for folder in ("first", "second"):
        team.mrbt("up", str(EXPLORE), "--detach", "--run-dir", str(team.folder / folder))
    for command in (["pause"], ["kill", "R1"], ["join", "R3"], ["status"], ["watch"], ["down"]):
        refused = team.command(*command)
        assert (refused.returncode, refused.stdout) == (2, "")
        assert "2 teams run here: name one with" in refused.stderr
        assert f"  {team.folder / 'first'}\n" in refused.stderr
    for folder in ("first", "second"):
        team.mrbt("down", "--run-dir", str(team.folder / folder))
    assert [run["alive"] for run in json.loads(team.mrbt("ls", "--json"))["runs"]] == [0, 0]


def test_a_borrowed_robot_is_replaced_and_stays_borrowed_when_it_starts_again(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    assert "R1 is borrowed by " in team.mrbt("borrow", "R1")
    team.wait_for_event("explore", "cancel", robot="R1")
    assert "R1 is not borrowed" not in team.mrbt("status")

    def reasons() -> set[str]:
        return set(team.status()["robots"]["R1"]["pending"].values())

    team.wait_until(lambda: any("borrowed by " in each for each in reasons()), "it is seen")
    team.mrbt("join", "R1", "--takeover")
    team.wait_until(lambda: any("borrowed by " in each for each in reasons()), "it still is")
    assert "R1 works for the team again" in team.mrbt("return", "R1")
    again = team.command("return", "R1")
    assert again.returncode == 1
    assert "R1 is not borrowed" in again.stderr
    team.wait_for_events(3, "explore")
    team.release()
    assert team.end()[0] == 0, team.logs()
