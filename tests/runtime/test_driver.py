"""The driver around an agent, on a transport that is slow to open."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.runtime import driver
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.robot_process import make_driver
from tests.support.paths import mission_file
from tests.support.slow_transport import SlowTransport

EXPLORE = mission_file("explore")


def test_a_robot_whose_start_takes_long_starts_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "ZenohTransport", SlowTransport)
    options = RobotOptions(
        listen=("tcp/127.0.0.1:0",),
        beat_s=0.1,
        detection_s=0.3,
        expect=("R1",),
        speed=100,
        run_dir=tmp_path,
        exit_when_done=True,
    )
    stop = make_driver(EXPLORE, "R1", options).run()
    assert (stop.code, stop.reason) == (0, "mission success")
