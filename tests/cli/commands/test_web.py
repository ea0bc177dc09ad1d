"""`mrbt web`: what cannot be is said before anything is started."""

from __future__ import annotations

import socket
import sys
from pathlib import Path

import pytest

from mrbt_mesh.cli.team import page_options
from tests.support.command import REPAIR, mrbt


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_options, "NEEDED", ("no_such_module",))
    code, _, problem = mrbt("web", "--mission", REPAIR)
    assert code == 2
    assert "pip install 'mrbt-mesh[web]'" in problem


def test_without_a_run_there_is_no_page(tmp_path: Path) -> None:
    code, _, problem = mrbt("web", MRBT_STATE_DIR=str(tmp_path))
    assert code == 2
    assert "Traceback" not in problem


@pytest.mark.parametrize("option", [("--port", "8000"), ("--control",), ("--host", "::1")])
def test_options_of_the_page_need_a_page(option: tuple[str, ...]) -> None:
    code, _, problem = mrbt("up", REPAIR, *option)
    assert code == 2
    assert "give --web as well" in problem


def test_nobody_serves_a_page_that_is_detached() -> None:
    code, _, problem = mrbt("up", REPAIR, "--detach", "--web")
    assert code == 2
    assert "see mrbt web" in problem


@pytest.mark.parametrize("port", ["-1", "65536", "x"])
def test_a_port_is_a_port(port: str) -> None:
    assert mrbt("web", "--port", port)[0] == 2


@pytest.mark.parametrize("command", [["web", "--mission"], ["up", "--web"]])
def test_a_port_that_is_taken_is_named(command: list[str]) -> None:
    """In one line, before a team is looked for or started."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        code, output, problem = mrbt(*command, REPAIR, "--port", str(port))
    assert (code, output) == (2, "")
    what = f"the page cannot be served at 127.0.0.1 port {port}: Address already in use"
    assert problem == f"error: {what}\n"


def test_a_port_for_foxglove_needs_foxglove() -> None:
    code, _, problem = mrbt("web", "--mission", REPAIR, "--foxglove-port", "8765")
    assert code == 2
    assert "give --foxglove as well" in problem


def test_without_its_extra_foxglove_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    code, _, problem = mrbt("web", "--mission", REPAIR, "--foxglove")
    assert code == 2
    assert "pip install 'mrbt-mesh[foxglove]'" in problem
