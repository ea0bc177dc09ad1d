"""Shows a recording: in the terminal as it was live, as lines, or one state of it as data."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time
from collections.abc import Iterator
from typing import Any

import click
from rich.live import Live
from rich.text import Text

from mrbt_mesh.cli.terminal import console
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.player import Player
from mrbt_mesh.views.replay.shown_recording import Playback
from mrbt_mesh.views.terminal.live import LiveNotes, LiveView

FRAME_S = 0.05
STEP_US = 5 * SECOND_US
FASTER = 2.0
LEFT, RIGHT, UP, DOWN = b"\x1b[D", b"\x1b[C", b"\x1b[A", b"\x1b[B"
KEYS = "space pauses, ← → 5 s, ↑ ↓ speed, q ends"


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


class Playing(Playback):
    """A replay in a terminal; `press` takes a key, `is_over` once its viewer ends it.

    Raises InputError as `state_data`.
    """

    def __init__(self, player: Player, at_s: float, speed: float) -> None:
        self.is_over = False
        super().__init__(player, time_of(player, at_s), speed)

    def go_to(self, at_us: int) -> None:
        """Go there at once."""
        super().go_to(at_us)
        self.catch_up()

    def press(self, key: bytes) -> None:
        """What the key asks for; others mean nothing."""
        if key == b" ":
            self.is_paused = not self.is_paused
        elif key in (LEFT, RIGHT):
            self.go_to(self.at_us + (STEP_US if key == RIGHT else -STEP_US))
        elif key in (UP, DOWN):
            self.set_speed(self.speed * (FASTER if key == UP else 1 / FASTER))
        elif key in (b"q", b"\x03", b"\x04"):
            self.is_over = True

    def line(self) -> str:
        """What stands above the view."""
        done_s = (self.at_us - self.player.begin_us) / SECOND_US
        length_s = (self.player.end_us - self.player.begin_us) / SECOND_US
        how = "paused" if self.is_paused else f"{self.speed:g} times as fast"
        return f"{done_s:.1f} of {length_s:.1f} s, {how}   {KEYS}"


def show_live(player: Player, at_s: float, speed: float) -> None:
    """The live view, until its viewer ends it."""
    playing, view = Playing(player, at_s, speed), LiveView()
    with _keys() as pressed, Live(console=console, screen=True, auto_refresh=False) as live:
        before_s = time.monotonic()
        while not playing.is_over:
            seen = player.observer if player.observer.record.started_us is not None else None
            frame = (
                view.render(seen, playing.at_us, console.size, LiveNotes(warning=playing.line()))
                if seen is not None
                else Text(playing.line())
            )
            live.update(frame, refresh=True)
            playing.press(pressed(FRAME_S))
            now_s = time.monotonic()
            playing.passed(now_s - before_s)
            before_s = now_s


@contextlib.contextmanager
def _keys() -> Iterator[Any]:
    """A function that waits so many seconds for a key: its bytes, none without one."""
    import termios
    import tty

    if not sys.stdin.isatty():
        raise InputError("the view needs a terminal to take keys from")
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)

    def pressed(wait_s: float) -> bytes:
        ready, _, _ = select.select([terminal], [], [], wait_s)
        return os.read(terminal, 8) if ready else b""

    try:
        tty.setcbreak(terminal)
        yield pressed
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
