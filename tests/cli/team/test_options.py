"""Where commands look for a team: what cannot be is said before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.team.network_options import TeamNetworkOptions
from mrbt_mesh.cli.team.options import TeamOptions
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError
from mrbt_mesh.runtime.team import new_run
from tests.support.command import mrbt
from tests.support.paths import ROOT

EXPLORE = ROOT / "examples" / "explore" / "mission.yaml"
NOTHING = Given(())
ON_A_TEAM = ("watch", "status", "fault", "restore", "leave", "pause", "resume", "abort", "decide")


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (["--team", "t"], "found with its --mission file"),
        (["--transport", "wireless"], "--transport: a team on the network"),
        (["--beat", "0.2"], "--beat: a team on the network"),
        (
            ["--mission", str(EXPLORE), "--transport", "wireless"],
            "links over quic need the team's keys",
        ),
        (["--mission", str(EXPLORE), "--beat", "nan"], "nan: expected a number, above 0"),
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
    arguments["decide"] = ["explore_area(A)", "done"]
    code, output, problems = mrbt(command, *arguments.get(command, []), *where)
    assert (code, output) == (2, "")
    assert message in problems


def test_variables_stand_for_the_options_of_a_team_on_the_network() -> None:
    code, _, problems = mrbt("status", MRBT_MISSION=str(EXPLORE), MRBT_TEAM="a/b")
    assert (code, "--team 'a/b'" in problems) == (2, True)


def test_an_observer_looks_where_the_robots_of_the_same_options_are() -> None:
    mission = load_mission(EXPLORE)
    found = TeamOptions(mission=EXPLORE).find(NOTHING)
    assert (found.transport.team, found.run) == ("explore", mission.digest[:8])
    assert found.transport.multicast_interface == "auto"
    assert found.run_dir is None
    network = TeamNetworkOptions(team="t", run="r", connect=("tcp/127.0.0.1:1",))
    named = TeamOptions(network, mission=EXPLORE).find(NOTHING)
    assert (named.transport.team, named.run) == ("t", "r")
    assert named.transport.multicast_interface is None
    assert named.transport.connect == ("tcp/127.0.0.1:1",)


def test_a_run_directory_says_all_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    mission = load_mission(EXPLORE)
    info = new_run(mission, EXPLORE, ["R1", "R2"], "p.py", beat_s=0.1, detection_s=0.5, speed=1.0)
    RunDir.create(tmp_path / "run", info, compile_mission(mission))
    found = TeamOptions(run_dir=tmp_path / "run").find(NOTHING)
    assert (found.transport.team, found.run) == (info.team, info.run)
    assert set(found.transport.connect) == set(info.endpoints.values())
    assert found.timing.detection_us == 500_000
    assert found.run_dir is not None
    with pytest.raises(RunDirError):
        TeamOptions(run_dir=tmp_path).find(NOTHING)
    with pytest.raises(InputError):
        TeamOptions(run_dir=tmp_path / "run", mission=EXPLORE).find(NOTHING)
