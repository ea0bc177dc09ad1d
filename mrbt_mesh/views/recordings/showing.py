"""Show a recording as lines, as the state at one time, or in the browser."""

from __future__ import annotations

from typing import Any

import click

from mrbt_mesh.cli.watching import served_until_interrupted
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.errors import InputError
from mrbt_mesh.plugins import ViewerOptions
from mrbt_mesh.recording.player import Player


def time_of(player: Player, at_s: float) -> int:
    """Return the time `at_s` after the begin; raises InputError for a time after the end."""
    length_s = (player.end_us - player.begin_us) / SECOND_US
    if at_s > length_s:
        raise InputError(f"--at {at_s:g}: the recording ends at {length_s:.3f} s")
    return player.begin_us + round(at_s * SECOND_US)


def state_data(player: Player, at_s: float | None) -> dict[str, Any]:
    """Return the state `at_s` after the begin, by default at the end; raises as `time_of`."""
    at_us = player.end_us if at_s is None else time_of(player, at_s)
    for _ in player.play_to(at_us, skips=True):
        pass
    return {
        "robot": player.recording.metadata.robot or None,
        "run": player.recording.metadata.run,
        "at_s": (at_us - player.begin_us) / SECOND_US,
        "ends_at_s": (player.end_us - player.begin_us) / SECOND_US,
        "torn": player.recording.torn or None,
        **player.state.to_json(),
    }


def show_lines(player: Player, at_s: float) -> None:
    """Print the events from `at_s` on; raises InputError as `time_of`."""
    from_us = time_of(player, at_s)
    timeline, printed = player.observer.record.timeline, 0
    for _ in player.play_to(player.end_us):
        for at_us, text in timeline[printed:]:
            if at_us >= from_us:
                click.echo(f"{(at_us - player.begin_us) / SECOND_US:8.2f}  {text}")
        printed = len(timeline)


async def serve(
    player: Player,
    at_s: float,
    speed: float,
    host: str,
    port: int,
    as_json: bool,
) -> None:
    """Serve the recording's page until SIGINT or SIGTERM, and print the address. Raises
    InputError.
    """
    from mrbt_mesh.views.replay.shown_recording import ShownRecording
    from mrbt_mesh.views.web.projector import showing_recording

    shown = ShownRecording(player, time_of(player, at_s), speed)
    async with showing_recording(shown, ViewerOptions(host, port)) as page:
        await served_until_interrupted("page", page, as_json)
