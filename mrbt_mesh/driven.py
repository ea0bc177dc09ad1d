"""A coroutine that can be abandoned even if it shields itself or swallows cancellations."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import sysconfig
from collections.abc import Awaitable, Callable, Coroutine, Generator
from functools import cache, partial
from pathlib import Path
from typing import Any

# A coroutine that swallows this many counted cancellations will not stop by itself.
MAX_SWALLOWED = 1_000


class GivenUpError(Exception):
    """Raised when the coroutine is abandoned; `place` is the file and line where it was."""

    def __init__(self, text: str, place: str) -> None:
        super().__init__(f"{text} ({place})")
        self.place = place


class Driven:
    """Awaits something, and counts cancellations that carry `token` in their message.

    It is abandoned if it continues after MAX_SWALLOWED of these. Its own timeouts (`move_on_after`,
    `asyncio.timeout`) arrive as cancellations too, but do not count. `step` runs each step of the
    coroutine. If there is a `gate`, each step passes through it first, and may have to wait there.
    """

    def __init__(
        self,
        awaitable: Awaitable[Any],
        token: str,
        step: Callable[[Callable[[], Any]], Any] = lambda run: run(),
    ) -> None:
        self.is_given_up = False
        self.gate: Callable[[], Generator[Any, None, None]] | None = None
        self._step = step
        self._token = token
        self._cancellations = 0
        self._coroutine: Coroutine[Any, Any, Any] = (
            awaitable if inspect.iscoroutine(awaitable) else _awaited(awaitable)
        )

    def cancelled(self) -> None:
        """Called at each cancellation, including those that do not count."""

    def frames(self) -> list[tuple[str, int]]:
        """Return where it waits: file and line, outermost first."""
        found = []
        each: Any = self._coroutine
        while (frame := getattr(each, "cr_frame", None)) is not None:
            found.append((frame.f_code.co_filename, frame.f_lineno))
            each = each.cr_await
        return found

    def __await__(self) -> Generator[Any, None, Any]:
        step: Callable[[], Any] = partial(self._coroutine.send, None)
        while True:
            while self.gate is not None:
                try:
                    yield from self.gate()
                    break
                except asyncio.CancelledError as cancellation:
                    step = self._thrown(cancellation)
            try:
                awaited = self._step(step)
            except StopIteration as end:
                return end.value
            try:
                yield awaited
                step = partial(self._coroutine.send, None)
            except asyncio.CancelledError as cancellation:
                del step
                step = self._thrown(cancellation)
            except GeneratorExit:
                self._coroutine.close()
                raise
            except BaseException as error:
                # The awaited operation has failed; the coroutine may catch the error.
                del step
                step = partial(self._coroutine.throw, error)

    def _thrown(self, cancellation: asyncio.CancelledError) -> Callable[[], Any]:
        """Return the step in which the coroutine is cancelled; raises GivenUpError."""
        self.cancelled()
        texts = (text for text in cancellation.args if isinstance(text, str))
        self._cancellations += any(self._token in text for text in texts)
        if self.is_given_up or self._cancellations > MAX_SWALLOWED:
            raise self._end() from None
        return partial(self._coroutine.throw, cancellation)

    def _end(self) -> GivenUpError:
        """Close the coroutine while the event loop runs, as it might run forever without one."""
        frames = self.frames()
        with contextlib.suppress(RuntimeError):  # it ignores this too
            self._coroutine.close()
        self._coroutine = _awaited(None)
        self._coroutine.close()
        text = "still ran when it was given up"
        if not self.is_given_up:
            text = f"goes on after {MAX_SWALLOWED} cancellations"
        return GivenUpError(text, innermost(frames))


def innermost(frames: list[tuple[str, int]]) -> str:
    """Return the last place outside libraries, else the last place, as `robot.py:12`."""
    own = [place for place in frames if not is_library(Path(place[0]))]
    file, line = (own or frames or [("?", 0)])[-1]
    return f"{Path(file).name}:{line}"


def is_library(file: Path) -> bool:
    """True if a file belongs to Python or an installed package."""
    return not file.is_absolute() or any(file.is_relative_to(each) for each in _libraries())


@cache
def _libraries() -> list[Path]:
    return [Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")]


async def _awaited(awaitable: Any) -> Any:
    return await awaitable
