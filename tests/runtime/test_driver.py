"""The driver around an agent, on a transport that is slow to open."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from mrbt_mesh.runtime import driver
from mrbt_mesh.runtime.robot_process import RobotStart, make_driver
from mrbt_mesh.runtime.team_address import on_network
from tests.support.paths import mission_file
from tests.support.slow_transport import SlowTransport

EXPLORE = mission_file("explore")


def test_a_robot_whose_start_takes_long_starts_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "ZenohTransport", SlowTransport)
    start = RobotStart(
        EXPLORE, "R1", expect=("R1",), speed=100, run_dir=tmp_path, exit_when_done=True
    )
    where = {"robot": "R1", "listen": ("tcp/127.0.0.1:0",), "beat_s": 0.1, "detection_s": 0.3}
    stop = make_driver(start, partial(on_network, **where)).run()
    assert (stop.code, stop.reason) == (0, "mission success")
