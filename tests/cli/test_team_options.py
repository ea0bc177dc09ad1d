"""Where commands look for a team: wrong input is refused before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.cli.team_options import TeamOptions
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError
from mrbt_mesh.runtime.team import new_run
from tests.support.command import mrbt, refused
from tests.support.paths import ROOT

EXPLORE = ROOT / "examples" / "explore" / "mission.yaml"
ON_A_TEAM = {
    "watch": (),
    "status": (),
    "fault": ("R1", "all"),
    "leave": ("R1",),
    "pause": (),
    "resume": (),
    "abort": (),
    "decide": ("explore_area(A)", "done"),
}
NO_VARIABLES: dict[str, str] = {}


@pytest.mark.parametrize(
    ("where", "variables", "message"),
    [
        (["--team", "t"], NO_VARIABLES, "No such option '--team'"),
        (["--mission", str(EXPLORE)], {"MRBT_TRANSPORT": "wireless"}, "quic need the team's keys"),
        (["--mission", str(EXPLORE)], {"MRBT_BEAT": "nan"}, "nan: a number of at most"),
        (["--mission", str(EXPLORE), "--run-dir", "x"], NO_VARIABLES, "two ways to name a team"),
        (["--mission", str(EXPLORE)], {"MRBT_TEAM": "a/b"}, "--team 'a/b': 1 to 32 letters"),
        (["--mission", str(EXPLORE)], {"MRBT_BEAT": "1"}, "at least 3 beat periods"),
        (["--mission", "nothing.yaml"], NO_VARIABLES, "nothing.yaml"),
        (["--run-dir", "nowhere"], NO_VARIABLES, "nowhere holds no run"),
    ],
)
@pytest.mark.parametrize("command", ON_A_TEAM)
def test_where_no_team_can_be_is_explained(
    command: str, where: list[str], variables: dict[str, str], message: str
) -> None:
    assert message in refused(mrbt(command, *ON_A_TEAM[command], *where, **variables))


def test_an_observer_looks_where_robots_with_the_same_variables_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mission = load_mission(EXPLORE)
    found = TeamOptions(None, EXPLORE).find()
    assert (found.transport.team, found.run) == ("explore", mission.digest[:8])
    assert found.transport.multicast_interface == "auto"
    assert found.run_dir is None
    monkeypatch.setenv("MRBT_TEAM", "t")
    monkeypatch.setenv("MRBT_RUN", "r")
    monkeypatch.setenv("MRBT_CONNECT", "tcp/127.0.0.1:1,tcp/127.0.0.1:2")
    monkeypatch.setenv("MRBT_DETECTION", "3")
    named = TeamOptions(None, EXPLORE).find()
    assert (named.transport.team, named.run) == ("t", "r")
    assert named.transport.multicast_interface is None
    assert named.transport.connect == ("tcp/127.0.0.1:1", "tcp/127.0.0.1:2")
    assert named.timing.detection_us == 3_000_000


def test_a_run_directory_says_all_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    mission = load_mission(EXPLORE)
    info = new_run(
        mission, EXPLORE, ["R1", "R2"], RobotOptions(program="p.py", beat_s=0.1, detection_s=0.5)
    )
    RunDir.create(tmp_path / "run", info, compile_mission(mission))
    found = TeamOptions(tmp_path / "run", None).find()
    assert (found.transport.team, found.run) == (info.team, info.run)
    assert set(found.transport.connect) == set(info.endpoints.values())
    assert found.timing.detection_us == 500_000
    assert found.run_dir is not None
    with pytest.raises(RunDirError):
        TeamOptions(tmp_path, None).find()
    with pytest.raises(InputError):
        TeamOptions(tmp_path / "run", EXPLORE).find()
