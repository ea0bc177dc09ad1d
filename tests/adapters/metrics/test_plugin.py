"""A robot's driver serves its metrics while it runs."""

from __future__ import annotations

import contextlib
import re
import socket
import threading
from pathlib import Path
from urllib.request import urlopen

import pytest

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime import driver
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.robot_process import make_driver
from tests.support.paths import mission_file
from tests.support.slow_transport import SlowTransport

EXPLORE = mission_file("explore")


def pages(port: int, found: list[str]) -> None:
    """Read the robot's metrics until it has joined, and written that down."""
    is_written = re.compile("mrbt_joined 1.0.*mrbt_journal_sync_duration_seconds_count [1-9]", re.S)
    while not found or not is_written.search(found[-1]):
        with contextlib.suppress(OSError):
            page = urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5).read().decode()
            found.append(page)


def test_a_robot_serves_metrics_while_it_lives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "ZenohTransport", SlowTransport)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = RobotOptions(
        listen=("tcp/127.0.0.1:0",),
        beat_s=0.1,
        detection_s=0.3,
        expect=("R1",),
        speed=20,
        run_dir=tmp_path,
        exit_when_done=True,
        metrics_port=port,
    )
    found: list[str] = []
    reader = threading.Thread(target=pages, args=(port, found), daemon=True)
    reader.start()
    stop = make_driver(EXPLORE, "R1", options).run()
    reader.join()
    assert stop.code == 0
    last = found[-1]
    assert 'mrbt_robot_info{mission="explore",robot="R1"' in last
    assert "mrbt_event_loop_responds 1.0" in last
    # Beginning a life is written to the journal, synced.
    (syncs,) = re.findall(r"mrbt_journal_sync_duration_seconds_count (\S+)", last)
    assert float(syncs) >= 1
    with pytest.raises(OSError, match="refused"):
        urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5)


def test_a_robot_that_cannot_serve_metrics_refuses_to_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "ZenohTransport", SlowTransport)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        options = RobotOptions(run_dir=tmp_path, metrics_port=port)
        robot = make_driver(EXPLORE, "R1", options)
        with pytest.raises(InputError, match=f"metrics cannot be served on 127.0.0.1:{port}"):
            robot.run()
