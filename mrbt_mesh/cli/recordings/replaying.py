"""A recording as lines, or one state of it as data."""

from __future__ import annotations

from typing import Any

import click

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.player import Player


def time_of(player: Player, at_s: float) -> int:
    """The time so many seconds from the begin; raises InputError for one behind the end."""
    length_s = (player.end_us - player.begin_us) / SECOND_US
    if at_s > length_s:
        raise InputError(f"--at {at_s:g}: the recording ends at {length_s:.3f} s")
    return player.begin_us + round(at_s * SECOND_US)


def state_data(player: Player, at_s: float | None) -> dict[str, Any]:
    """The state at so many seconds from the begin, by default at the end.

    Raises InputError for a time that the recording has not.
    """
    length_s = (player.end_us - player.begin_us) / SECOND_US
    at_us = player.end_us if at_s is None else time_of(player, at_s)
    player.seek(at_us)
    robot = player.recording.metadata.robot
    head = {"robot": robot or None, "run": player.recording.metadata.run}
    at = {"at_s": (at_us - player.begin_us) / SECOND_US, "ends_at_s": length_s}
    return head | at | player.state.to_json()


def show_lines(player: Player, at_s: float) -> None:
    """Print what happened from a time on; raises InputError as `state_data`."""
    from_us = time_of(player, at_s)
    player.seek(player.end_us)
    record = player.observer.record
    for at_us, text in record.timeline:
        if at_us >= from_us:
            click.echo(f"{(at_us - player.begin_us) / SECOND_US:8.2f}  {text}")
