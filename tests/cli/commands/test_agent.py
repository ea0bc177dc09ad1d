"""`mrbt agent`: what its options become, and what is refused before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime import robot_process
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.team_address import TeamAddress, on_network
from tests.support.command import EXPLORE, mrbt, refused

Started = tuple[RobotOptions, TeamAddress]


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Started]:
    """What `mrbt agent` would run."""
    found: list[Started] = []

    def run(mission: Path, robot: str, options: RobotOptions) -> None:
        found.append((options, on_network(load_mission(mission), options, robot)))

    monkeypatch.setattr(robot_process, "run_robot", run)
    return found


def test_a_robot_on_the_network(started: list[Started]) -> None:
    code, output, problems = mrbt("agent", "--mission", EXPLORE, "--robot", "R1", "--insecure")
    assert (code, output) == (0, "")
    assert problems.startswith("mrbt: warning: not secure")
    ((options, address),) = started
    assert address.keys is None
    assert options == RobotOptions(insecure=True)
    assert (address.transport.team, address.transport.robot) == ("explore", "R1")
    assert address.transport.multicast_interface == "auto"


def test_every_option_arrives(started: list[Started], tmp_path: Path) -> None:
    keys = KeyFolder.create(tmp_path / "keys", {"R9": Role.ROBOT}).path
    words = ["--type", "explorer", "--program", "p.py", "--solver", "cp_sat", "--speed", "2"]
    words += ["--run-dir", str(tmp_path), "--takeover", "--exit-when-done", "--expect", "R1,R2"]
    words += ["--while-locked", "launcher.lock", "--keys", str(keys)]
    words += ["--record", "r.mcap", "--record-beats"]
    words += ["--alone-after", "20", "--alone"]
    words += ["--join-timeout", "3", "--team", "t", "--run", "r", "--listen", "tcp/127.0.0.1:1"]
    words += ["--connect", "tcp/127.0.0.1:2", "--connect", "tcp/127.0.0.1:3", "--beat", "0.1"]
    code, _, problems = mrbt(
        "agent", "--mission", EXPLORE, "--robot", "R9", *words, "--detection", "0.4"
    )
    assert (code, problems) == (0, "")
    ((options, address),) = started
    expected = RobotOptions(
        type="explorer",
        program="p.py",
        solver="cp_sat",
        expect=("R1", "R2"),
        gather_s=3,
        alone_after_s=20,
        alone=True,
        run_dir=tmp_path,
        speed=2,
        takeover=True,
        while_locked=Path("launcher.lock"),
        record=Path("r.mcap"),
        record_beats=True,
        exit_when_done=True,
        team="t",
        run="r",
        listen=("tcp/127.0.0.1:1",),
        connect=("tcp/127.0.0.1:2", "tcp/127.0.0.1:3"),
        keys=keys,
        beat_s=0.1,
        detection_s=0.4,
    )
    assert options == expected
    # As a launcher gives them to its robots.
    again = ("agent", "--mission", EXPLORE, "--robot", "R9", *expected.arguments())
    assert mrbt(*again)[0] == 0
    assert started[1][0] == expected
    assert (address.transport.team, address.run, address.keys) == ("t", "r", keys)
    assert address.transport.listen == ("tcp/127.0.0.1:1",)
    assert address.transport.connect == ("tcp/127.0.0.1:2", "tcp/127.0.0.1:3")
    assert (address.timing.heartbeat_us, address.timing.detection_us) == (100_000, 400_000)


def test_a_robot_has_keys_or_is_told_that_it_needs_none(
    started: list[Started], tmp_path: Path
) -> None:
    words = ("agent", "--mission", EXPLORE, "--robot", "R1")
    problems = refused(mrbt(*words))
    assert "`mrbt keys init DIR --robots R1,...`" in problems
    assert "or --insecure" in problems
    assert "--keys: with --insecure nothing is signed" in refused(
        mrbt(*words, "--insecure", "--keys", "keys")
    )
    assert started == []
    keys = KeyFolder.create(tmp_path / "keys", {"R1": Role.ROBOT}).path
    assert mrbt(*words, MRBT_KEYS=str(keys)) == (0, "", "")
    assert [address.keys for _, address in started] == [keys]


def test_metrics_are_for_this_machine_unless_said_otherwise(started: list[Started]) -> None:
    words = ("agent", "--mission", EXPLORE, "--robot", "R1", "--insecure")
    assert mrbt(*words, "--metrics-port", "9464")[0] == 0
    assert mrbt(*words, "--metrics-port", "9464", "--metrics-host", "0.0.0.0")[0] == 0
    found = [(options.metrics_port, options.metrics_host) for options, _ in started]
    assert found == [(9464, "127.0.0.1"), (9464, "0.0.0.0")]
    assert "--metrics-host: give --metrics-port too" in refused(
        mrbt(*words, "--metrics-host", "0.0.0.0")
    )
    assert mrbt(*words, "--metrics-port", "0")[0] == 2


def test_variables_stand_for_options_and_options_win(
    started: list[Started], tmp_path: Path
) -> None:
    keys = KeyFolder.create(tmp_path / "keys", {"R1": Role.ROBOT}).path
    variables = {"MRBT_MISSION": EXPLORE, "MRBT_TEAM": "t", "MRBT_RUN": "r"}
    variables["MRBT_KEYS"] = str(keys)
    assert mrbt("agent", "--robot", "R1", "--team", "other", **variables)[0] == 0
    ((_, address),) = started
    assert (address.mission.name, address.transport.team, address.run) == ("explore", "other", "r")


def test_clients_of_routers_neither_listen_nor_look_around(started: list[Started]) -> None:
    words = ["--mission", EXPLORE, "--robot", "R1", "--insecure"]
    assert mrbt("agent", *words, "--router", "tcp/a:1,tcp/b:2")[0] == 0
    assert mrbt("agent", *words, MRBT_ROUTER="tcp/a:1")[0] == 0
    transports = [address.transport for _, address in started]
    assert [transport.routers for transport in transports] == [("tcp/a:1", "tcp/b:2"), ("tcp/a:1",)]
    assert all(transport.multicast_interface is None for transport in transports)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--robot", "R1"], "Missing option '--mission'"),
        (["--mission", EXPLORE], "Missing option '--robot'"),
        (["--mission", EXPLORE, "--robot", "R1", "--beat", "inf"], "inf is not in the range"),
        (["--mission", EXPLORE, "--robot", "R1", "--speed", "0"], "0.01<=x<=1000"),
        (["--mission", EXPLORE, "--robot", "R1", "--join-timeout", "-1"], "0<=x<=86400"),
        (["--mission", EXPLORE, "--robot", "R1", "--bogus"], "No such option '--bogus'"),
        (["--mission", EXPLORE, "--robot", "R1", "more"], "unexpected extra argument (more)"),
        (["--mission", EXPLORE, "--robot", "R1", "--transport", "x"], "'x' is not one of"),
    ],
)
def test_what_cannot_be_is_refused(started: list[Started], words: list[str], message: str) -> None:
    code, output, problems = mrbt("agent", *words)
    assert (code, output, started) == (2, "", [])
    assert message in problems


def test_heartbeats_are_a_part_of_a_recording(started: list[Started]) -> None:
    words = ("agent", "--mission", EXPLORE, "--robot", "R1", "--insecure", "--record-beats")
    assert "--record-beats: of a recording: give --record as well" in refused(mrbt(*words))
    assert not started


def test_a_launchers_options_do_not_depend_on_the_environment(started: list[Started]) -> None:
    words = RobotOptions(insecure=True).arguments()
    variables = {"MRBT_BEAT": "0.1", "MRBT_DETECTION": "5", "MRBT_TRANSPORT": "wireless"}
    assert mrbt("agent", "--mission", EXPLORE, "--robot", "R1", *words, **variables)[0] == 0
    assert started[0][0] == RobotOptions(insecure=True)
