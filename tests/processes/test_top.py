"""`mrbt watch --top` in a real terminal, over a real team."""

from __future__ import annotations

from tests.support.team import EXPLORE, Team
from tests.support.terminal import Terminal


def test_a_robot_is_looked_at_and_killed_by_keys(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    before = team.running()
    with Terminal("watch", "--top", "--control", environment=team.environment) as terminal:
        robot = terminal.wait_for(r"(R\d) ● \w")[1]
        terminal.press("tab", "i")
        terminal.wait_for(f"T_i of {robot}")
        terminal.wait_for("T_A, how it plans: Sequence")
        terminal.press("escape")
        terminal.wait_for("─tree─")
        terminal.press("k")
        terminal.wait_for(rf"kill {robot}\?")
        terminal.press("y")
        terminal.wait_for(f"{robot} ✖ dead")
        terminal.press("q")
        assert terminal.wait_for_end() == 0, terminal.text
    # The team goes on without that robot, and without whoever watched.
    assert len(team.running()) == len(before) - 1
    team.release()
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success")
    assert summary["robots"][robot]["state"] == "dead"


def test_up_shows_the_team_then_its_summary_and_a_recording_is_replayed(team: Team) -> None:
    arguments = (str(EXPLORE), "--speed", "5", "--run-dir", str(team.run_dir))
    team.hold("explore")
    with Terminal("up", *arguments, environment=team.environment) as terminal:
        terminal.wait_for(r"R\d ● \w")
        team.release()
        terminal.wait_for("mission succeeded")
        assert terminal.wait_for_end() == 0, terminal.text
    replayed = ("recording", "replay", f"{team.run_dir}/run.mcap")
    with Terminal(*replayed, environment=team.environment) as terminal:
        terminal.wait_for(r"run\.mcap: \d+\.\d of \d+\.\d s, 1 times as fast")
        terminal.press(" ")
        terminal.wait_for("paused")
        terminal.press("q")
        assert terminal.wait_for_end() == 0, terminal.text
