"""Identifies the process that wrote a file, and whether it still runs, whatever the clock does."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import psutil

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_START_TICKS = 19  # among the fields of /proc/PID/stat after the name: see proc_pid_stat(5)


def identity_of_this_process() -> str:
    """Return this process's pid and what distinguishes it from others with that pid, for
    `process_in`.
    """
    return json.dumps({"pid": os.getpid(), "started": _started(os.getpid())})


def identity_of(pid: int) -> str:
    """Return the identity of another process. Raises OSError if there is none."""
    return json.dumps({"pid": pid, "started": _started(pid)})


def clock_id() -> str:
    """Identify the clock that `boottime_us` reads: the machine's boot, and the time namespace.

    Times of one clock can be compared, whatever the wall clock was set to meanwhile. Empty if it is
    not known.
    """
    try:
        boot = _BOOT_ID.read_text(encoding="ascii").strip()
        offsets = Path("/proc/self/timens_offsets").read_text(encoding="ascii").split()
    except (OSError, ValueError):
        return ""
    return "/".join([boot, *(each for each in offsets[-2:] if each != "0")])


def is_this_clock(clock: object) -> bool:
    """Return whether a file's times are on the clock that this process reads now.

    `clock`: the `clock_id` in the file. An empty one, or none, counts as another clock.
    """
    return bool(clock) and clock == clock_id()


def process_in(path: Path) -> psutil.Process | None:
    """Return the process whose identity is in a file, if it runs.

    None if another one has its pid.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if _started(data["pid"]) != data["started"]:
            return None
    except (OSError, ValueError, TypeError, KeyError):
        return None
    import psutil

    try:
        process = psutil.Process(data["pid"])
        return process if process.status() != psutil.STATUS_ZOMBIE else None
    except psutil.Error:
        return None


def _started(pid: int) -> str:
    """Return when a process began: which boot of the machine, and how many ticks after it.

    On Linux its Unix time is useless: it is computed from a time of boot that follows the clock.
    """
    if sys.platform != "linux":
        import psutil

        try:
            return f"{psutil.Process(pid).create_time():.2f}"
        except psutil.Error as error:
            raise ProcessLookupError(str(error)) from error
    boot = _BOOT_ID.read_text(encoding="ascii").strip()
    # The name may contain blanks and parentheses.
    fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
    return f"{boot}/{int(fields[_START_TICKS])}"
