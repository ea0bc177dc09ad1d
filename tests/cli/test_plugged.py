"""Views by their options."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from mrbt_mesh.plugins import VIEWS
from tests.support.command import EXPLORE, mrbt


@pytest.mark.parametrize("view", [name for name in VIEWS.names() if name != "top"])
def test_a_view_that_cannot_listen_is_refused_before_robots_begin(
    view: str, tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        words = ["up", EXPLORE, f"--{view}", "--port", port, "--run-dir", str(run_dir)]
        code, _, problems = mrbt(*words)
    assert code == 2, problems
    assert port in problems or "needs the extra" in problems
    assert not run_dir.exists()


def test_a_view_of_a_robot_that_is_not_there_is_refused_before_robots_begin(tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    words = ["up", EXPLORE, "--web", "--port", "0", "--robot", "X9", "--run-dir", str(run_dir)]
    code, _, problems = mrbt(*words)
    assert (code, "--robot X9: mission explore has no robot 'X9'" in problems) == (2, True), (
        problems
    )
    assert not run_dir.exists()
