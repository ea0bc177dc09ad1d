"""Finds coroutines that a program creates and never awaits: a forgotten `await`.

Python warns of each when it is deleted, with its name only. Here the program's call that created it
is told, so that it fails instead of succeeding at once.
"""

from __future__ import annotations

import gc
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

# How many frames to record, to find the program's line that created a coroutine.
DEPTH = 5

Frames = list[tuple[str, int]]
_warn: Callable[[Any], None] = warnings._warn_unawaited_coroutine  # type: ignore[attr-defined]
_is_collecting = False


def tell_of_never_awaited(tell: Callable[[str, Frames], bool]) -> None:
    """Call `tell` with each such coroutine's name and its frames of creation, outermost first.

    Python warns as usual if `tell` returns False, and for coroutines found only by the garbage
    collector, which may run in any call.
    """

    def warn(coroutine: Any) -> None:
        made = [(file, line) for file, line, _ in coroutine.cr_origin or ()][::-1]
        if _is_collecting or not tell(coroutine.__qualname__, made or _here()):
            _warn(coroutine)

    warnings._warn_unawaited_coroutine = warn  # type: ignore[attr-defined]


def _here() -> Frames:
    found, frame = [], sys._getframe(2)
    for _ in range(DEPTH):
        found.append((frame.f_code.co_filename, frame.f_lineno))
        if frame.f_back is None:
            break
        frame = frame.f_back
    return found[::-1]


@contextmanager
def noting_where_coroutines_are_made() -> Iterator[None]:
    """Track the origin of coroutines that are created in this context."""
    before = sys.get_coroutine_origin_tracking_depth()
    sys.set_coroutine_origin_tracking_depth(max(before, DEPTH))
    try:
        yield
    finally:
        sys.set_coroutine_origin_tracking_depth(before)


def _collecting(phase: str, _: Mapping[str, int]) -> None:
    global _is_collecting
    _is_collecting = phase == "start"


gc.callbacks.append(_collecting)
