"""How commands end: exit statuses, and errors as messages."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import NoReturn

SUCCESS, FAILURE, BAD_INPUT, NOT_FINISHED = 0, 1, 2, 3
EXIT_OF_RESULT = {
    "success": SUCCESS,
    "failure": FAILURE,
    "timeout": NOT_FINISHED,
    "blocked": NOT_FINISHED,
    "not_started": NOT_FINISHED,
}


def fail(message: str, code: int = BAD_INPUT) -> NoReturn:
    """Print a message for people on stderr and end with an exit status."""
    from mrbt_mesh.cli.framework.terminal import errors, labelled

    errors.print(labelled("error", "bold red", message), soft_wrap=True)
    raise SystemExit(code)


def end_process(code: int) -> NoReturn:
    """End a process that had a Zenoh session: closing one can take 10 s, so do not wait."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code)
