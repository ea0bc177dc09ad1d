"""The workshop's world as a process: bodies in real time, behind a Unix socket.

    python examples/workshop/world.py             # begin; Ctrl-C ends it
    python examples/workshop/world.py --judge     # how do things lie? 0: the vehicle is mended

It knows robots by name, and nothing of their tasks or their team. A robot that says nothing for a
quarter of a second stops where it is.
"""

from __future__ import annotations

import contextlib
import json
import signal
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import anyio
import anyio.abc
import click
from bodies.link import GONE, address, receive, send
from bodies.messages import Command, MessageError

from mrbt_mesh import InputError

STEP_S = 0.01
# So much is caught up after a pause; what is more has not happened.
MOST_S = 0.1
JUDGE_S = 5.0


class Server:
    """A world in real time, and those who are connected to it.

    `again`: all is put back once the last robot has left.
    """

    def __init__(self, broken: tuple[str, ...], again: bool) -> None:
        # A missing extra is reported as wrong input.
        from bodies.physics import World

        self._begin = partial(World, broken)
        self.world = self._begin()
        self._again = again
        self._streams: dict[str, anyio.abc.SocketStream] = {}
        self._told = 0
        self._refused: set[str] = set()

    async def run(self, path: Path) -> None:
        """Serve until it is cancelled. Raises InputError where a world is already."""
        await _make_way(path)
        listener = await anyio.create_unix_listener(path)
        path.chmod(0o600)
        click.echo(f"the world is at {path}")
        try:
            async with listener, anyio.create_task_group() as group:
                group.start_soon(self._pass_time)
                await listener.serve(self._serve)
        finally:
            path.unlink(missing_ok=True)

    async def _pass_time(self) -> None:
        passed_s, seen_s = 0.0, time.monotonic()
        world = self.world
        while True:
            await anyio.sleep(STEP_S)
            now_s = time.monotonic()
            if world is not self.world:
                world, passed_s = self.world, 0.0
            passed_s += min(MOST_S, now_s - seen_s)
            seen_s = now_s
            world.advance_to(passed_s)
            for event in world.events[self._told :]:
                click.echo(f"{event['at_s']:8.2f} s  {event['what']}")
            self._told = len(world.events)

    async def _serve(self, stream: anyio.abc.SocketStream) -> None:
        """One connection, to its end; whatever comes over it, the others go on."""
        robot = ""
        async with stream:
            try:
                first = await receive(stream)
                if first == {"judge": True}:
                    await send(stream, self.world.judged())
                    return
                robot = await self._attach(first, stream)
                await send(stream, self.world.senses(robot).plain())
                while True:
                    command = Command.read(await receive(stream))
                    await send(stream, self.world.exchange(robot, command).plain())
            except MessageError as error:
                self._refuse(robot, str(error))
                with contextlib.suppress(*GONE):
                    await send(stream, {"error": str(error)})
            except GONE:
                pass
            finally:
                self._leave(robot, stream)

    async def _attach(self, first: dict[str, Any], stream: anyio.abc.SocketStream) -> str:
        robot = str(first.get("robot"))
        if len(first) != 1 or robot not in self.world.robots:
            known = ", ".join(self.world.robots)
            raise MessageError(f"first comes {{'robot': one of {known}}}, or {{'judge': true}}")
        before = self._streams.pop(robot, None)
        self._streams[robot] = stream
        if before is not None:
            await before.aclose()
        click.echo(f"{self.world.time_s:8.2f} s  {robot} is connected")
        return robot

    def _leave(self, robot: str, stream: anyio.abc.SocketStream) -> None:
        if self._streams.get(robot) is not stream:
            return
        del self._streams[robot]
        click.echo(f"{self.world.time_s:8.2f} s  {robot} is no longer connected")
        if self._again and not self._streams:
            self.tell()
            self.world, self._told = self._begin(), 0

    def _refuse(self, robot: str, why: str) -> None:
        """Tell what was refused, once for each who sends it."""
        if robot not in self._refused:
            self._refused.add(robot)
            click.echo(f"refused a message of {robot or 'a stranger'}: {why}", err=True)

    def tell(self) -> None:
        """Say how things lie."""
        click.echo(verdict(self.world.judged()))


def verdict(judged: dict[str, Any]) -> str:
    """What the judge says, for people."""
    if judged["mended"]:
        replaced = ", ".join(judged["parts_replaced"]) or "none"
        return f"the vehicle is mended: new parts {replaced}, the cover and its screws in place"
    return "the vehicle is not mended: " + "; ".join(judged["problems"])


async def ask_judge(path: Path) -> dict[str, Any]:
    """What the world at a socket says of itself. Raises InputError if there is none."""
    try:
        with anyio.fail_after(JUDGE_S):
            async with await anyio.connect_unix(path) as stream:
                await send(stream, {"judge": True})
                return await receive(stream)
    except (OSError, TimeoutError, anyio.EndOfStream) as error:
        raise InputError(f"there is no world at {path}: {error}") from None


async def _make_way(path: Path) -> None:
    """Remove what a world that has died left behind."""
    if not path.exists():
        return
    try:
        await (await anyio.connect_unix(path)).aclose()
    except ConnectionRefusedError:
        path.unlink()
    except OSError as error:
        raise InputError(f"{path}: {error}") from None
    else:
        raise InputError(f"a world is at {path} already; $WORKSHOP_WORLD names another place")


async def _until_signal(scope: anyio.CancelScope) -> None:
    with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
        async for _ in signals:
            scope.cancel()
            return


async def _main(server: Server, path: Path) -> None:
    async with anyio.create_task_group() as group:
        group.start_soon(_until_signal, group.cancel_scope)
        await server.run(path)


@click.command(help=__doc__)
@click.option("--judge", is_flag=True, help="Ask the world that runs how things lie in it.")
@click.option("--json", "as_json", is_flag=True, help="With --judge: all that it says, as JSON.")
@click.option("--broken", default="2,4", show_default=True, help="Which parts, of 1 to 5.")
@click.option("--again", is_flag=True, help="Put all back once the last robot has left.")
def main(judge: bool, as_json: bool, broken: str, again: bool) -> None:
    try:
        if judge:
            said = anyio.run(ask_judge, address())
            click.echo(json.dumps(said, indent=2) if as_json else verdict(said))
            sys.exit(0 if said["mended"] else 1)
        server = Server(tuple(filter(None, broken.split(","))), again)
        _run(server)
        server.tell()
    except (InputError, BaseExceptionGroup) as error:
        _tell_error(error)


def _run(server: Server) -> None:
    anyio.run(_main, server, address())


def _tell_error(error: BaseException) -> None:
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    if not isinstance(error, InputError):
        raise error
    click.echo(f"error: {error}", err=True)
    sys.exit(2)


if __name__ == "__main__":
    main()
