"""Finds coroutines that a program makes and never awaits: a forgotten `await`.

Python warns of each when it is deleted, with the name alone. Here the call of the program that made
it is told, so that it fails instead of having succeeded after no time.
"""

from __future__ import annotations

import gc
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

# How far to look back for the line of the program that made a coroutine.
DEPTH = 5

Frames = list[tuple[str, int]]
_warn: Callable[[Any], None] = warnings._warn_unawaited_coroutine  # type: ignore[attr-defined]
_is_collecting = False


def tell_of_never_awaited(tell: Callable[[str, Frames], bool]) -> None:
    """Call `tell` with the name of each such coroutine and where it was made, the outermost first.

    Python warns as usual where `tell` returns False, and of what is only found by the collector of
    garbage, in whichever call that runs.
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
    """For coroutines that are made within."""
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
