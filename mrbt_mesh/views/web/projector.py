"""Plays a recording for all pages, each of which may control the playback."""

from __future__ import annotations

import math
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

import anyio

from mrbt_mesh.plugins import ViewerOptions
from mrbt_mesh.views.replay.shown_recording import ShownRecording
from mrbt_mesh.views.web.app import Page
from mrbt_mesh.views.web.feed import FRAME_US, Feed
from mrbt_mesh.views.web.server import served

# How many records are played before other tasks run.
STEP_RECORDS = 20


class RecordingProjector:
    """Plays while a page is open. `feed`: the feed that pages follow."""

    def __init__(self, shown: ShownRecording) -> None:
        self._shown = shown
        self.feed = Feed(shown, lambda: shown.playback.at_us)
        self._is_wished = anyio.Event()

    def to_json(self) -> Mapping[str, Any]:
        """Return the constant properties of the recording."""
        return self._shown.to_json()

    def carry_out(self, wish: Any) -> None:
        """Apply `paused`, `at_s` (from the start of the run) and `speed`, or some of them.

        Raises ValueError for anything else.
        """
        if not isinstance(wish, dict) or not wish.keys() <= {"paused", "at_s", "speed"}:
            raise ValueError("a wish has paused, at_s or speed, and nothing else")
        at_s, speed = (_number(wish, name) for name in ("at_s", "speed"))
        paused = wish.get("paused")
        if paused is not None and not isinstance(paused, bool):
            raise ValueError("paused is true or false")
        if speed is not None:
            if speed <= 0:
                raise ValueError("speed is above 0")
            self._shown.playback.set_speed(speed)
        if at_s is not None:
            self._shown.go_to(at_s)
        if paused is not None:
            self._shown.play(paused)
        self._is_wished.set()

    async def run(self) -> None:
        """Play; never returns."""
        before_s = time.monotonic()
        while True:
            frame_ends_s = before_s + FRAME_US / 1e6
            while not self._is_wished.is_set() and time.monotonic() < frame_ends_s:
                if self._shown.read(STEP_RECORDS):
                    with anyio.move_on_after(frame_ends_s - time.monotonic()):
                        await self._is_wished.wait()
                else:
                    await anyio.sleep(0)
            self._is_wished = anyio.Event()
            now_s = time.monotonic()
            if self.feed.pages:
                self._shown.passed(now_s - before_s)
            before_s = now_s
            while not self._shown.step(STEP_RECORDS):
                await anyio.sleep(0)
            self.feed.show()


def _number(wish: Mapping[str, Any], name: str) -> float | None:
    value = wish.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1e9:
        raise ValueError(f"{name} is a number of no more than nine digits")
    if not math.isfinite(value):
        raise ValueError(f"{name} is a number")
    return float(value)


@asynccontextmanager
async def showing_recording(shown: ShownRecording, options: ViewerOptions) -> AsyncIterator[str]:
    """Serve and play a recording; yield the page's address. Raises PageError."""
    projector = RecordingProjector(shown)
    page = lambda own: Page(projector.feed, own, projector=projector).application()  # noqa: E731
    async with (
        served(options, projector.feed.close, page) as address,
        anyio.create_task_group() as group,
    ):
        group.start_soon(projector.run)
        yield address
        group.cancel_scope.cancel()
