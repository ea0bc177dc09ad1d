"""The live page of a team that runs already, was there, or is yet to come."""

from __future__ import annotations

import signal
import sys
from collections.abc import Mapping

import anyio
import click

from mrbt_mesh.cli.framework.exits import SUCCESS
from mrbt_mesh.cli.framework.terminal import print_json
from mrbt_mesh.cli.team.joined_late import past_of
from mrbt_mesh.recording.metadata import RunMetadata
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import Watcher, watching
from mrbt_mesh.views.web.server import PageOptions, follow, serving


async def serve(
    address: TeamAddress, options: PageOptions, foxglove_port: int | None, as_json: bool
) -> int:
    """Serve the page until SIGINT or SIGTERM; says where. Raises TransportError or InputError.

    Foxglove is served on its port as well, if there is one.
    """
    found = address.run_dir
    team = Team(found, found.info(), address.mission) if found is not None else None
    async with (
        watching(address, tell_past=past_of(team)) as watcher,
        serving(watcher, team, options) as (shown, feed),
    ):
        if team is not None and not team.living():
            # It is over: what its journals hold is all there is to see.
            team.result(watcher.observer, boottime_us())
        addresses = {"page": shown}
        if foxglove_port is not None:
            addresses["foxglove"] = _serve_foxglove(watcher, options.host, foxglove_port)
        say_addresses(addresses, as_json)
        async with anyio.create_task_group() as group:
            group.start_soon(follow, watcher, feed)
            if team is not None:
                group.start_soon(team.note_exits, watcher)
            await until_stopped()
            group.cancel_scope.cancel()
    return SUCCESS


def _serve_foxglove(watcher: Watcher, host: str, port: int) -> str:
    """Until the watcher is closed. Returns the address; raises InputError."""
    from mrbt_mesh.adapters.foxglove import FoxgloveServer

    opened: list[FoxgloveServer] = []

    def opening(metadata: RunMetadata) -> FoxgloveServer:
        opened.append(FoxgloveServer(metadata, host, port))
        return opened[0]

    watcher.record_to(opening)
    return opened[0].address


def say_addresses(addresses: Mapping[str, str], as_json: bool) -> None:
    """What is served where, for people or for programs."""
    if as_json:
        print_json(dict(addresses))
    else:
        click.echo("\n".join(f"{what}: {where}" for what, where in addresses.items()))
    sys.stdout.flush()


async def until_stopped() -> None:
    """Returns once SIGINT or SIGTERM has come."""
    with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
        async for _ in signals:
            return
