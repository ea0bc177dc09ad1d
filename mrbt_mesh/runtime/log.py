"""structlog, imported without what a robot's process has no use for.

structlog imports rich and pygments where they are installed, for coloured tracebacks: 9 MB in
every robot. They are hidden while it is imported, and there for everybody else afterwards.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mrbt_mesh.runtime.limited_file import DEFAULT_KEEP_BYTES, LimitedLog
from mrbt_mesh.runtime.run_dir import RunDir

# Events with a `reason` that are printed as well.
SHOWN = ("no_other_robot_heard", "address_changed")
_hidden = "rich" not in sys.modules
if _hidden:
    sys.modules["rich"] = None  # type: ignore[assignment]
try:
    import structlog
finally:
    if _hidden:
        del sys.modules["rich"]


def configure_log(robot: str, run_dir: Path | None, keep_bytes: int = DEFAULT_KEEP_BYTES) -> None:
    """JSON lines to the run directory's `<robot>.log`, or readable lines to the terminal.

    Lines that cannot be written are dropped, and counted in the file once it can be written again.
    That a robot does not hear others is printed as well: who starts it looks there first.
    """

    def show(_: object, __: str, event: Any) -> Any:
        if event["event"] in SHOWN:
            with contextlib.suppress(OSError, ValueError):
                sys.stdout.write(f"{robot}: {event['reason']}\n")
                sys.stdout.flush()
        return event

    stamp = structlog.processors.TimeStamper(fmt="iso", utc=True)
    file: Any = sys.stderr
    if run_dir is not None:
        renderer: Any = structlog.processors.JSONRenderer()

        def lost(count: int, reason: str) -> str:
            fields = {"event": "log_lines_lost", "robot": robot, "count": count, "reason": reason}
            return str(renderer(None, "", stamp(None, "", {**fields, "level": "error"})))

        shown = [show]
        file = LimitedLog(RunDir(run_dir).log_path(robot), keep_bytes, lost)
    else:
        shown = []
        renderer = structlog.dev.ConsoleRenderer(
            colors=sys.stderr.isatty(), exception_formatter=structlog.dev.plain_traceback
        )
    structlog.configure(
        processors=[*shown, structlog.processors.add_log_level, stamp, renderer],
        logger_factory=structlog.WriteLoggerFactory(file),
        cache_logger_on_first_use=True,
    )


class StandardLog:
    """A robot's log inside another program: that of `logging` with the name `mrbt_mesh.ROBOT`."""

    def __init__(self, robot: str) -> None:
        import logging

        self._logger = logging.getLogger(f"mrbt_mesh.{robot}")

    def __getattr__(self, level: str) -> Callable[..., None]:
        write: Callable[[str], None] = getattr(self._logger, level)

        def log(event: str, **fields: Any) -> None:
            write(" ".join([event, *(f"{name}={value!r}" for name, value in fields.items())]))

        return log


def robot_logger(robot: str) -> Any:
    """The log of one robot."""
    return structlog.get_logger().bind(robot=robot)
