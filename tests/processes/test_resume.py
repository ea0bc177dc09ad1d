"""A run survives the death of its whole team: the journals bring it back."""

from __future__ import annotations

import pytest

from mrbt_mesh.drills.journals import read
from mrbt_mesh.drills.physical import spans
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.run_dir import RunDir
from tests.support.paper_run import check_order
from tests.support.team import EXPLORE, REPAIR, Team


@pytest.mark.smoke
@pytest.mark.parametrize(
    ("local_task", "next_one"),
    [
        ("do_diagnosis", "replace_hw"),
        pytest.param("replace_hw", "replace_wires", marks=pytest.mark.slow),
    ],
)
def test_the_whole_team_killed_goes_on_where_it_was(
    team: Team, local_task: str, next_one: str
) -> None:
    team.hold(next_one)
    team.up()
    team.wait_for_event(local_task, "end")
    # An action ends in the world a moment before its outcome is in the journal, and what ends
    # in that moment is done again.
    done = {e["activation"] for e in team.events() if e["outcome"] == "success"}
    team.wait_until(lambda: done <= _journaled(team), "what has ended is in a journal")
    team.kill_all()
    code, summary = team.end()
    assert (code, summary["result"]) == (3, "blocked")
    assert summary["ended_because"] == "no robot is left"
    before = len(team.events())
    team.release()
    team.up(REPAIR, "--continue")
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["result"] == "success"
    again = {e["activation"] for e in team.events()[before:]}
    assert not again & done, "finished work was done again"
    check_order(spans(team.events()))


def _journaled(team: Team) -> set[str]:
    """Activations with a success that some journal holds."""
    run_dir = RunDir(team.run_dir)
    mission = load_mission(run_dir.mission_path)
    held = read(team.run_dir, team.robots(), mission.digest, run_dir.info().run)
    return {done.activation for kept in held.values() for done in kept}


def test_resume_refuses_a_running_team_another_mission_and_no_directory(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_event("explore")
    running = team.command("up", str(EXPLORE), "--run-dir", str(team.run_dir), "--continue")
    assert running.returncode == 2
    assert "still run; see `mrbt watch`" in running.stderr
    team.kill_all()
    team.end()
    other = team.command("up", str(REPAIR), "--run-dir", str(team.run_dir), "--continue")
    assert other.returncode == 2
    assert "is a run of another mission" in other.stderr
    nowhere = team.command("up", str(EXPLORE), "--continue")
    assert nowhere.returncode == 2
    assert "--continue needs the --run-dir" in nowhere.stderr
    fresh = team.command("up", str(EXPLORE), "--run-dir", str(team.run_dir))
    assert fresh.returncode == 2
    assert "or add --continue" in fresh.stderr.replace("\n", " ")
