"""A run that an operator has ended on purpose is neither blocked nor late: it says by whom."""

from __future__ import annotations

import time
from typing import Any

from mrbt_mesh.core.observer.run_record import RunRecord
from mrbt_mesh.runtime.command_log import noted_commands
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.run_dir import COMMANDS_FILE, RunDir

# The result of such a run, in place of one of these.
ENDED = "ended"
UNFINISHED = ("timeout", "blocked")
DOWN = "down"
# From the command on robots leave: what is blocked from then on was not in the way.
LEAVING_US = 1_000_000


def ended_by_command(run_dir: RunDir) -> tuple[str, float] | None:
    """Who has ended the team by `mrbt down`, in words, and when, as Unix time in s; None: nobody,
    or it has gone on since.
    """
    try:
        content = (run_dir.path / COMMANDS_FILE).read_bytes()
    except OSError:
        return None
    noted = [each for each in noted_commands(content, "", None) if each.unix_s is not None]
    if not noted or noted[-1].by != f"mrbt {DOWN}":
        return None
    return noted[-1].command, noted[-1].unix_s or 0.0


def with_operator_end(
    summary: dict[str, Any], record: RunRecord, run_dir: RunDir | None, why: str
) -> dict[str, Any]:
    """The summary of a run that has ended before its mission; `why`: if no command has ended it,
    what did, empty if that was no operator.
    """
    command = ended_by_command(run_dir) if run_dir is not None else None
    if command is None and not why:
        return summary
    text, unix_s = command or (why, time.time())
    summary = summary | {"ended_because": text}
    before_us = boottime_us() - round((time.time() - unix_s) * 1e6) - LEAVING_US
    was_blocked = any(e.to_us is None and e.from_us < before_us for e in record.blocked)
    if summary["result"] in UNFINISHED and not was_blocked:
        summary["result"] = ENDED
    return summary
