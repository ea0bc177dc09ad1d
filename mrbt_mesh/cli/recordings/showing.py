"""A recording in the browser."""

from __future__ import annotations

import signal
import sys

import anyio
import click

from mrbt_mesh.cli.command import SUCCESS
from mrbt_mesh.cli.recordings.replaying import time_of
from mrbt_mesh.cli.terminal import print_json
from mrbt_mesh.recording.player import Player
from mrbt_mesh.views.replay.shown_recording import ShownRecording
from mrbt_mesh.views.web.projector import show_recording
from mrbt_mesh.views.web.server import PageOptions


async def serve(
    player: Player, at_s: float, speed: float, options: PageOptions, as_json: bool
) -> int:
    """Serve its page until SIGINT or SIGTERM, and print the address. Raises InputError."""
    shown = ShownRecording(player, time_of(player, at_s), speed)

    def print_address(page: str) -> None:
        if as_json:
            print_json({"page": page})
        else:
            click.echo(f"page: {page}")
        sys.stdout.flush()

    async with anyio.create_task_group() as group:
        group.start_soon(show_recording, shown, options, print_address)
        with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
            async for _ in signals:
                break
        group.cancel_scope.cancel()
    return SUCCESS
