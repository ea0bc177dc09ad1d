"""The robot's end of the pipe to its bridge: the bridge's process, and messages both ways."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import anyio
import anyio.abc
import msgpack

from mrbt_mesh.adapters.binding import News
from mrbt_mesh.adapters.ros2.binding_file import BindingFile, bind_message
from mrbt_mesh.errors import InputError

FOLDER = Path(__file__).with_name("bridge")
CHECK_S = 60.0
# Time for the bridge to cancel its remaining goals before it ends.
STOP_S = 5.0
MAX_SAID = 2_000
# Set by PyPI's ROS packages once they have set LD_LIBRARY_PATH and restarted Python.
WHEELS_VARIABLE = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


def bridge_command(file: BindingFile) -> list[str]:
    """Return the command line that starts the bridge."""
    # If the ROS Python has no msgpack, the pure-Python one of this environment is used.
    words = [file.python, str(FOLDER), str(Path(msgpack.__file__).parent)]
    if file.setup is None:
        return words
    suffix = Path(file.setup).suffix
    shell = suffix[1:] if suffix in (".bash", ".zsh") else "sh"
    return [shell, "-c", '. "$0" && exec "$@"', file.setup, *words]


def bridge_environment(file: BindingFile) -> dict[str, str]:
    """Return the bridge's environment variables."""
    domain = {} if file.bridge.domain is None else {"ROS_DOMAIN_ID": str(file.bridge.domain)}
    return {**_without_wheels(os.environ), **domain}


def _without_wheels(environment: Mapping[str, str]) -> dict[str, str]:
    """Remove the variables that PyPI's ROS packages have set for this Python.

    Another Python has to set its own, and would otherwise assume that this has been done.
    """
    found = dict(environment)
    if found.pop(WHEELS_VARIABLE, None) is None:
        return found
    places = found.pop("LD_LIBRARY_PATH", "").split(os.pathsep)
    own = str(Path(sys.prefix, "lib"))
    left = [p for p in places if p and p != own and not fnmatch(Path(p).name, "ros_*.libs")]
    return found | ({"LD_LIBRARY_PATH": os.pathsep.join(left)} if left else {})


def check_bindings(file: BindingFile, command: list[str] | None = None) -> None:
    """Let the bridge check that the bindings fit the ROS types.

    Raises InputError, with the lines, if they do not, or if no bridge can be started.
    """
    if file.parameters is not None and not Path(file.parameters).is_file():
        place = file.place("bridge", "parameters")
        raise InputError(f"{place}: there is no file {file.parameters}")
    command = command or bridge_command(file)
    place = file.place("bridge", "python")
    try:
        done = subprocess.run(
            command,
            input=msgpack.packb(bind_message(file, None)),
            env=bridge_environment(file),
            capture_output=True,
            timeout=CHECK_S,
            check=False,
        )
    except OSError as error:
        raise InputError(f"{place}: {command[0]}: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise InputError(f"{place}: {file.python} did not answer within {CHECK_S:g} s") from None
    unpacker = msgpack.Unpacker()
    unpacker.feed(done.stdout)
    for message in unpacker:
        if message["op"] == "failed":
            raise InputError(f"{place}: {message['text']}; name the Python that has rclpy")
        if message["problems"]:
            raise file.unfit(message["problems"])
        return
    said = done.stderr.decode(errors="replace").strip()[-MAX_SAID:]
    raise InputError(f"{place}: the bridge ended with status {done.returncode}: {said}")


class BridgePipe:
    """Messages to and from a running bridge."""

    def __init__(self, process: anyio.abc.Process) -> None:
        self._process = process
        self._unpacker = msgpack.Unpacker()
        self._outbox: list[dict[str, Any]] = []
        self._news = News()

    def say(self, message: dict[str, Any]) -> None:
        """Queue a message to the bridge."""
        self._outbox.append(message)
        self._news.tell()

    async def send_on(self) -> None:
        """Send queued messages until the bridge has ended."""
        assert self._process.stdin is not None
        try:
            while True:
                while self._outbox:
                    await self._process.stdin.send(msgpack.packb(self._outbox.pop(0)))
                await self._news.wait()
        except (anyio.BrokenResourceError, anyio.ClosedResourceError, OSError):
            return

    async def heard(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the bridge's messages until it has ended."""
        assert self._process.stdout is not None
        async for chunk in self._process.stdout:
            self._unpacker.feed(chunk)
            for message in self._unpacker:
                yield message

    async def complaints(self) -> AsyncIterator[str]:
        """Yield the lines that ROS and the bridge write to standard error."""
        assert self._process.stderr is not None
        rest = b""
        async for chunk in self._process.stderr:
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                yield line.decode(errors="replace")[:MAX_SAID]
            rest = rest[-MAX_SAID:]
        if rest:
            yield rest.decode(errors="replace")


@asynccontextmanager
async def bridge_process(
    command: list[str], environment: dict[str, str]
) -> AsyncIterator[BridgePipe]:
    """Start a bridge; on exit it cancels its goals and ends. Raises OSError."""
    # Ctrl-C in a terminal must only reach the robot, which then stops the bridge cleanly.
    process = await anyio.open_process(command, env=environment, start_new_session=True)
    try:
        yield BridgePipe(process)
    finally:
        with anyio.CancelScope(shield=True):
            assert process.stdin is not None
            await process.stdin.aclose()
            with anyio.move_on_after(STOP_S):
                await process.wait()
            if process.returncode is None:
                process.kill()
            await process.aclose()
