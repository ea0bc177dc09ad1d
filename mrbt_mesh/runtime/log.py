"""A robot's log: JSON lines in its file, readable lines on a terminal."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mrbt_mesh.runtime.limited_file import DEFAULT_KEEP_BYTES, LimitedLog
from mrbt_mesh.runtime.run_dir import RunDir

# Events whose `reason` is also printed.
SHOWN = ("no_other_robot_heard", "address_changed")
EVENT_COLUMNS = 30


class RobotLog:
    """Writes events with their fields, one per call; `fields` are added to all of them."""

    def __init__(self, fields: Mapping[str, Any]) -> None:
        self._fields = dict(fields)

    def bind(self, **fields: Any) -> RobotLog:
        """Return the same log with more fields in each line."""
        return RobotLog(self._fields | fields)

    def debug(self, event: str, **fields: Any) -> None:
        self._write("debug", event, fields)

    def info(self, event: str, **fields: Any) -> None:
        self._write("info", event, fields)

    def warning(self, event: str, **fields: Any) -> None:
        self._write("warning", event, fields)

    def error(self, event: str, **fields: Any) -> None:
        self._write("error", event, fields)

    def _write(self, level: str, event: str, fields: Mapping[str, Any]) -> None:
        said = self._fields | dict(fields) | {"event": event, "level": level, "timestamp": _now()}
        _sink(said)


def configure_log(robot: str, run_dir: Path | None, keep_bytes: int = DEFAULT_KEEP_BYTES) -> None:
    """Log JSON lines to the run directory's `<robot>.log`, or readable lines to the terminal.

    Lines that cannot be written are dropped, and their number is logged once the file can be
    written again. That a robot does not hear any other is also printed, because whoever starts it
    looks there first.
    """
    global _sink
    if run_dir is None:
        _sink = _show
        return

    def lost(count: int, reason: str) -> str:
        fields = {"event": "log_lines_lost", "robot": robot, "count": count, "reason": reason}
        return _json({**fields, "level": "error", "timestamp": _now()})

    file = LimitedLog(RunDir(run_dir).log_path(robot), keep_bytes, lost)

    def write(said: Mapping[str, Any]) -> None:
        if said["event"] in SHOWN:
            with contextlib.suppress(OSError, ValueError):
                sys.stdout.write(f"{robot}: {said['reason']}\n")
                sys.stdout.flush()
        file.write(_json(said) + "\n")

    _sink = write


def _show(said: Mapping[str, Any]) -> None:
    """Print a line on standard error."""
    own = ("event", "level", "timestamp")
    fields = " ".join(f"{name}={_shown(value)}" for name, value in said.items() if name not in own)
    line = f"{said['timestamp']} [{said['level']:<7}] {said['event']:<{EVENT_COLUMNS}} {fields}"
    sys.stderr.write(line.rstrip() + "\n")


def _shown(value: object) -> str:
    """Return a single word as it is, and a text with spaces in quotes."""
    is_word = isinstance(value, str) and value.isprintable() and value.split() == [value]
    return str(value) if is_word else repr(value)


def _json(said: Mapping[str, Any]) -> str:
    return json.dumps(said, default=repr)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


# Where lines go; until a process configures it, they are shown.
_sink: Callable[[Mapping[str, Any]], None] = _show


class StandardLog:
    """A robot's log inside another program: the `logging` logger named `mrbt_mesh.ROBOT`."""

    def __init__(self, robot: str) -> None:
        import logging

        self._logger = logging.getLogger(f"mrbt_mesh.{robot}")

    def __getattr__(self, level: str) -> Callable[..., None]:
        write: Callable[[str], None] = getattr(self._logger, level)

        def log(event: str, **fields: Any) -> None:
            write(" ".join([event, *(f"{name}={value!r}" for name, value in fields.items())]))

        return log


def robot_logger(robot: str) -> RobotLog:
    """Return the log of one robot."""
    return RobotLog({"robot": robot})
