"""The driver around an agent, on a transport that is only slow."""

from __future__ import annotations

import threading
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.runtime import driver
from mrbt_mesh.runtime.robot_process import RobotStart, make_driver
from mrbt_mesh.runtime.team_address import on_network
from tests.support.paths import mission_file

EXPLORE = mission_file("explore")


class SlowTransport:
    """Takes longer to open than the detection time, as on a machine that is very busy."""

    def __init__(self, config: Any, deliver: Any) -> None:
        self.is_open = False
        self.told: list[str] = []

    def open(self) -> None:
        threading.Event().wait(0.6)
        self.is_open = True

    def __getattr__(self, name: str) -> Any:
        def used(*arguments: Any) -> list[str]:
            assert self.is_open, f"{name} before the session is open"
            self.told.append(name)
            return []

        return used


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
