"""What a launcher settles before robots start."""

from __future__ import annotations

import errno
import json
import socket
import sys
from pathlib import Path

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.launcher import HOST, agent_arguments, free_endpoints, with_newcomer
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir, RunInfo
from mrbt_mesh.runtime.team import new_run
from mrbt_mesh.runtime.team_address import AddressError
from tests.support.paths import mission_file


@pytest.mark.skipif(sys.platform != "linux", reason="ports are reserved on Linux")
def test_teams_that_start_side_by_side_get_different_ports() -> None:
    """None of their robots listens yet."""
    found = [endpoint for _ in range(3) for endpoint in free_endpoints(200, "tcp")]
    assert len(set(found)) == len(found)
    with socket.socket() as robot:
        robot.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        robot.bind((HOST, int(found[0].rpartition(":")[2])))
        robot.listen()


@pytest.mark.skipif(sys.platform != "linux", reason="the range of ports that Linux gives")
def test_a_datagram_port_is_none_that_the_system_gives_to_who_dials() -> None:
    found = [endpoint for _ in range(3) for endpoint in free_endpoints(20, "quic")]
    assert len(set(found)) == len(found)
    given = Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()
    for endpoint in found:
        port = int(endpoint.rpartition(":")[2])
        assert port < int(given[0])
        with socket.socket(type=socket.SOCK_DGRAM) as robot:
            robot.bind((HOST, port))


def run_with_metrics(first: int | None) -> RunInfo:
    mission = load_mission(mission_file("explore"))
    return new_run(
        mission,
        mission_file("explore"),
        ["R1", "R2"],
        RobotOptions(program="p.py", beat_s=0.1, insecure=True, metrics_port=first),
    )


def test_robots_serve_metrics_on_ports_in_a_row_and_a_newcomer_on_the_next(tmp_path: Path) -> None:
    info = run_with_metrics(9464)
    assert info.metrics_ports == {"R1": 9464, "R2": 9465}
    more = with_newcomer(info, "R3")
    run_dir = RunDir(tmp_path)
    run_dir.save(more)
    assert run_dir.info() == more
    words = agent_arguments(run_dir, more, "R3")
    assert words[words.index("--metrics-port") + 1] == "9466"
    targets = json.loads(run_dir.metrics_targets_path.read_text())
    assert [target["targets"] for target in targets] == [
        [f"127.0.0.1:{port}"] for port in (9464, 9465, 9466)
    ]
    assert targets[2]["labels"] == {"mission": "explore", "run": info.run, "robot": "R3"}


def test_a_run_without_metrics_says_nothing_of_them(tmp_path: Path) -> None:
    info = with_newcomer(run_with_metrics(None), "R3")
    run_dir = RunDir(tmp_path)
    run_dir.save(info)
    assert "--metrics-port" not in agent_arguments(run_dir, info, "R3")
    assert not run_dir.metrics_targets_path.exists()


def test_robots_for_whom_there_are_no_ports_are_refused() -> None:
    with pytest.raises(AddressError, match="2 robots have no ports from 65535 on: 65535 is"):
        run_with_metrics(65_535)


def test_a_team_is_refused_where_loopback_is_down(monkeypatch: pytest.MonkeyPatch) -> None:
    def unreachable(*_: object) -> None:
        raise OSError(errno.ENETUNREACH, "Network is unreachable")

    monkeypatch.setattr(socket, "create_connection", unreachable)
    with pytest.raises(AddressError, match=r"127.0.0.1 cannot be reached .* `ip link set lo up`"):
        free_endpoints(2, "tcp")
