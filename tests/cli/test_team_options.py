"""Where commands look for a team: what cannot be is said before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from mrbt_mesh.cli.app import app
from mrbt_mesh.cli.common import InputError
from mrbt_mesh.cli.team_options import find_team
from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError
from mrbt_mesh.runtime.team import new_run

EXPLORE = Path(__file__).resolve().parents[2] / "examples" / "explore" / "mission.yaml"
ON_A_TEAM = ("watch", "status", "fault", "restore", "leave", "pause", "resume", "abort")


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (["--team", "t"], "found with its --mission file"),
        (["--mission", str(EXPLORE), "--run-dir", "x"], "two ways to name a team: give one"),
        (["--mission", str(EXPLORE), "--team", "a/b"], "--team 'a/b': 1 to 32 letters"),
        (["--mission", str(EXPLORE), "--beat", "1"], "at least 3 beat periods"),
        (["--mission", "nothing.yaml"], "nothing.yaml"),
        (["--run-dir", "nowhere"], "nowhere holds no run"),
    ],
)
@pytest.mark.parametrize("command", ON_A_TEAM)
def test_where_no_team_can_be_is_explained(command: str, where: list[str], message: str) -> None:
    arguments = {"fault": ["R1", "--lose", "all"], "restore": ["R1"], "leave": ["R1"]}
    done = CliRunner().invoke(app, [command, *arguments.get(command, []), *where])
    assert done.exit_code == 2
    assert message in done.stderr.replace("\n", "")


def test_variables_stand_for_the_options_of_a_team_on_the_network() -> None:
    variables = {"MRBT_MISSION": str(EXPLORE), "MRBT_TEAM": "a/b"}
    done = CliRunner().invoke(app, ["status"], env=variables)
    assert (done.exit_code, "--team 'a/b'" in done.stderr) == (2, True)


def test_an_observer_looks_where_the_robots_of_the_same_options_are() -> None:
    mission = load_mission(EXPLORE)
    found = find_team(mission=EXPLORE)
    assert (found.transport.team, found.run) == ("explore", mission.digest[:8])
    assert found.transport.multicast_interface == "auto"
    assert found.run_dir is None
    named = find_team(mission=EXPLORE, team_name="t", run="r", connect=["tcp/127.0.0.1:1"])
    assert (named.transport.team, named.run) == ("t", "r")
    assert named.transport.multicast_interface is None
    assert named.transport.connect == ("tcp/127.0.0.1:1",)


def test_a_run_directory_says_all_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    mission = load_mission(EXPLORE)
    info = new_run(mission, EXPLORE, ["R1", "R2"], "p.py", beat_s=0.1, detection_s=0.5, speed=1.0)
    RunDir.create(tmp_path / "run", info, compile_mission(mission))
    found = find_team(run_dir=tmp_path / "run")
    assert (found.transport.team, found.run) == (info.team, info.run)
    assert set(found.transport.connect) == set(info.endpoints.values())
    assert found.timing.detection_us == 500_000
    assert found.run_dir is not None
    with pytest.raises(RunDirError):
        find_team(run_dir=tmp_path)
    with pytest.raises(InputError):
        find_team(run_dir=tmp_path / "run", mission=EXPLORE)
