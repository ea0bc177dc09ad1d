"""Messages over a real socket: whole ones, pieces of them, and what is none."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import anyio
import anyio.abc
import msgpack
import pytest
from bodies.link import MAX_BYTES, SocketLink, address, receive, send
from bodies.messages import Command, MessageError, Senses

from tests.support.paths import EXAMPLES, ROOT

SENSES = Senses(1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0, (4.0,), None, None)


def framed(packed: bytes) -> bytes:
    return struct.pack(">I", len(packed)) + packed


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("MRBT_BESIDE", raising=False)
    monkeypatch.setenv("WORKSHOP_WORLD", str(tmp_path / "w.sock"))
    return tmp_path / "w.sock"


async def heard(path: Path, *pieces: bytes) -> Any:
    """What `receive` makes of bytes that come in pieces, and then no more."""
    found: list[Any] = []
    listener = await anyio.create_unix_listener(path)

    async def serve(stream: anyio.abc.SocketStream) -> None:
        async with stream:
            try:
                found.append(await receive(stream))
            except Exception as error:
                found.append(error)
        group.cancel_scope.cancel()

    async with listener, anyio.create_task_group() as group:
        group.start_soon(listener.serve, serve)
        async with await anyio.connect_unix(path) as stream:
            for piece in pieces:
                await stream.send(piece)
            await stream.send_eof()
            await anyio.sleep_forever()
    return found[0]


async def test_a_message_may_come_in_pieces(path: Path) -> None:
    whole = framed(msgpack.packb({"robot": "A1"}))
    assert await heard(path, *(whole[i : i + 1] for i in range(len(whole)))) == {"robot": "A1"}


@pytest.mark.parametrize(
    ("sent", "why"),
    [
        (framed(b"\xc1"), "not msgpack"),
        (framed(msgpack.packb([1])), "a map is expected, not list"),
        (struct.pack(">I", MAX_BYTES + 1), f"at most {MAX_BYTES} bytes"),
        (framed(b""), "not msgpack"),
    ],
)
async def test_what_is_no_message(path: Path, sent: bytes, why: str) -> None:
    found = await heard(path, sent)
    assert isinstance(found, MessageError)
    assert why in str(found)


async def test_an_end_in_the_middle(path: Path) -> None:
    assert isinstance(await heard(path, b"\0\0"), anyio.EndOfStream)


async def answered(path: Path, answers: list[dict[str, Any]]) -> list[Any]:
    """What a robot gets from a world that gives these answers and then is gone."""
    got: list[Any] = []
    listener = await anyio.create_unix_listener(path)

    async def serve(stream: anyio.abc.SocketStream) -> None:
        async with stream:
            for answer in answers:
                got.append(await receive(stream))
                await send(stream, answer)

    async with listener, anyio.create_task_group() as group:
        group.start_soon(listener.serve, serve)
        link = await SocketLink.connect("A1")
        try:
            got.append(await link.sense())
            while True:
                got.append(await link.exchange(Command(forward=1.0)))
        except OSError as error:
            got.append(error)
        await link.close()
        group.cancel_scope.cancel()
    return got


async def test_a_robot_says_who_it_is_and_then_what_it_wants(path: Path) -> None:
    first, sensed, command, again, end = await answered(path, [SENSES.plain(), SENSES.plain()])
    assert first == {"robot": "A1"}
    assert sensed == again == SENSES
    assert Command.read(command) == Command(forward=1.0)
    assert isinstance(end, ConnectionResetError)


async def test_a_robot_that_is_refused_is_told_why(path: Path) -> None:
    _, end = await answered(path, [{"error": "no such robot"}])
    assert isinstance(end, ConnectionRefusedError)
    assert str(end) == "no such robot"


def test_where_the_world_is(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert address() == path
    monkeypatch.setenv("MRBT_BESIDE", "/run/here")
    assert address() == Path("/run/here/workshop.sock")
    monkeypatch.delenv("MRBT_BESIDE")
    monkeypatch.delenv("WORKSHOP_WORLD")
    assert address().name.startswith("workshop-")


WORKSHOP = EXAMPLES / "workshop"


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        [sys.executable, str(WORKSHOP / "world.py")],
        [sys.executable, str(WORKSHOP / "strip.py"), "strip.png"],
        [sys.executable, "-m", "mrbt_mesh", "sim", "run", str(WORKSHOP / "mission.yaml")],
    ],
    ids=lambda command: Path(command[1] if command[1] != "-m" else "mrbt").name,
)
def test_without_the_extra_it_is_said_what_to_install(path: Path, command: list[str]) -> None:
    """Also where it is installed: it is hidden."""
    hidden = "import sys\nsys.modules['mujoco'] = None\n"
    (path.parent / "sitecustomize.py").write_text(hidden)
    around = {**os.environ, "PYTHONPATH": f"{path.parent}{os.pathsep}{ROOT}"}
    done = subprocess.run(
        command, env=around, cwd=path.parent, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2, done.stderr
    assert "pip install 'mrbt-mesh[world]'" in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
