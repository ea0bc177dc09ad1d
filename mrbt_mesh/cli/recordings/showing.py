"""A recording in the browser."""

from __future__ import annotations

import anyio

from mrbt_mesh.cli.framework.exits import SUCCESS
from mrbt_mesh.cli.recordings.replaying import time_of
from mrbt_mesh.cli.team.page import say_addresses, until_stopped
from mrbt_mesh.recording.player import Player
from mrbt_mesh.views.replay.shown_recording import ShownRecording
from mrbt_mesh.views.web.projector import show_recording
from mrbt_mesh.views.web.server import PageOptions


async def serve(
    player: Player, at_s: float, speed: float, options: PageOptions, as_json: bool
) -> int:
    """Serve its page until SIGINT or SIGTERM; says where. Raises InputError."""
    shown = ShownRecording(player, time_of(player, at_s), speed)
    async with anyio.create_task_group() as group:
        say = lambda page: say_addresses({"page": page}, as_json)  # noqa: E731
        group.start_soon(show_recording, shown, options, say)
        await until_stopped()
        group.cancel_scope.cancel()
    return SUCCESS
