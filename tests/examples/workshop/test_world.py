"""The world as a process: who may connect, what it answers, how it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import anyio
import anyio.abc
import pytest

from tests.support.workshop import needs_world

needs_world()

from bodies.link import SocketLink, receive, send  # noqa: E402
from bodies.messages import Command  # noqa: E402
from world import Server, ask_judge, verdict  # noqa: E402

from mrbt_mesh.errors import InputError  # noqa: E402
from tests.support.paths import ROOT  # noqa: E402

WORLD = [sys.executable, str(ROOT / "examples/workshop/world.py")]


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("MRBT_BESIDE", raising=False)
    monkeypatch.setenv("WORKSHOP_WORLD", str(tmp_path / "w.sock"))
    return tmp_path / "w.sock"


@asynccontextmanager
async def serving(path: Path, *, again: bool = False) -> AsyncIterator[Server]:
    server = Server(("2",), again)
    async with anyio.create_task_group() as group:
        group.start_soon(server.run, path)
        while not path.exists():
            await anyio.sleep(0.01)
        yield server
        group.cancel_scope.cancel()
    assert not path.exists()


@asynccontextmanager
async def connected(robot: str) -> AsyncIterator[SocketLink]:
    link = await SocketLink.connect(robot)
    try:
        yield link
    finally:
        await link.close()


async def test_a_robot_drives_and_time_is_real(path: Path) -> None:
    async with serving(path), connected("A1") as link:
        before = await link.sense()
        while (senses := await link.exchange(Command(forward=1.0))).x < before.x + 0.3:
            await anyio.sleep(0.02)
        assert senses.time_s - before.time_s > 0.3


async def test_it_goes_on_whatever_somebody_says(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages: list[dict[str, Any]] = [
        {"robot": "Z9"},
        {"robot": ["A1"]},
        {"robot": "A1", "and": 1},
        {},
    ]
    async with serving(path):
        for message in messages:
            async with await anyio.connect_unix(path) as stream:
                await send(stream, message)
                said = await receive(stream)
                assert "first comes {'robot': one of A1, A2, B1, B2, C1, C2}" in said["error"]
        async with connected("A1") as link:
            await link.sense()
            with pytest.raises(ConnectionRefusedError, match="turn is a finite number"):
                await link.exchange(_Broken())  # type: ignore[arg-type]
        async with await anyio.connect_unix(path) as stream:
            await stream.send(b"GET / HTTP/1.1\r\n\r\n")
            assert "a message has at most" in (await receive(stream))["error"]
        async with connected("A1") as again:
            assert (await again.sense()).x == pytest.approx(-2)
    errors = capsys.readouterr().err.splitlines()
    assert [line.partition(":")[0] for line in errors] == [
        "refused a message of a stranger",
        "refused a message of A1",
    ]


class _Broken:
    def plain(self) -> dict[str, Any]:
        return {"turn": float("inf")}


async def test_who_comes_again_has_its_body_there(path: Path) -> None:
    """As a robot that starts again while its old process is frozen."""
    async with serving(path), connected("B1") as old, connected("B1") as new:
        await old.sense()
        await new.sense()
        with pytest.raises(ConnectionResetError):
            await old.exchange(Command())
        await new.exchange(Command())


async def test_the_judge_is_asked_from_outside(path: Path) -> None:
    async with serving(path):
        said = await ask_judge(path)
        assert said["problems"] == ["part 2 is broken", "part 2 lacks hardware"]
        text = "the vehicle is not mended: part 2 is broken; part 2 lacks hardware"
        assert verdict(said) == text
    with pytest.raises(InputError, match="there is no world at"):
        await ask_judge(path)


@pytest.mark.parametrize("again", [False, True])
async def test_all_is_put_back_for_the_next_team_if_that_is_wanted(path: Path, again: bool) -> None:
    async with serving(path, again=again) as server:
        first = server.world
        for robot in ("A1", "A2"):
            async with connected(robot) as link:
                await link.sense()
            while server._streams:
                await anyio.sleep(0.01)
        assert (server.world is first) is not again


def test_the_command_from_its_begin_to_its_end(path: Path) -> None:
    """It starts from anywhere, is the only one at its place, and says at the end how things lie."""
    there = subprocess.Popen(
        [*WORLD, "--broken", ""], stdout=subprocess.PIPE, text=True, cwd=path.parent
    )
    assert there.stdout is not None
    with there:
        assert there.stdout.readline() == f"the world is at {path}\n"
        second = subprocess.run(WORLD, capture_output=True, text=True, check=False)
        assert second.returncode == 2
        assert "error: a world is at" in second.stderr
        asked = subprocess.run(
            [*WORLD, "--judge", "--json"], capture_output=True, text=True, check=False
        )
        assert asked.returncode == 0
        assert json.loads(asked.stdout)["mended"] is True
        there.send_signal(signal.SIGTERM)
        assert there.stdout.read().startswith("the vehicle is mended: new parts none")
    assert there.returncode == 0
    alone = subprocess.run([*WORLD, "--judge"], capture_output=True, text=True, check=False)
    assert alone.returncode == 2
    assert alone.stderr.startswith(f"error: there is no world at {path}")


def test_what_a_dead_world_has_left_behind_is_no_hindrance(path: Path) -> None:
    for _ in range(2):
        there = subprocess.Popen(WORLD, stdout=subprocess.PIPE, text=True)
        with there:
            assert there.stdout is not None
            assert there.stdout.readline() == f"the world is at {path}\n"
            os.kill(there.pid, signal.SIGKILL)
        assert path.exists()


@pytest.mark.parametrize(
    ("options", "status", "why"),
    [
        (["--broken", "9"], 2, "error: parts are 1, 2, 3, 4, 5, not 9"),
        (["--help"], 0, "python examples/workshop/world.py --judge"),
    ],
)
def test_what_the_command_says(path: Path, options: list[str], status: int, why: str) -> None:
    done = subprocess.run([*WORLD, *options], capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert why in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
