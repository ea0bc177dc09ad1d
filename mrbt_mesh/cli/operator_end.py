"""Mark runs that an operator ended on purpose as ended, neither blocked nor late.

Requests that were blocked before the end stay in the summary; those that were blocked only because
robots were leaving do not.
"""

from __future__ import annotations

import time
from typing import Any

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.observer.headline import ENDED
from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.runtime.command_log import TeamEnd, last_end, team_ends
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.run_dir import RunDir

# Results that an operator's end replaces.
UNFINISHED = ("timeout", "blocked")
# Robots may begin to leave this long before the end is noted, as on Ctrl-C.
LEAVING_S = 1.0


def with_operator_end(
    summary: dict[str, Any], record: RunRecord, run_dir: RunDir | None, why: str
) -> dict[str, Any]:
    """Return the summary of a run that ended before its mission.

    `why` tells what ended the run if no command did; empty if that was not an operator.
    """
    ends = team_ends(run_dir) if run_dir is not None else []
    last = last_end(run_dir) if run_dir is not None else None
    if last is None and why:
        last = TeamEnd(why, time.time(), None)
        ends.append(last)
    if summary.get("blocked"):
        summary = summary | {"blocked": _in_the_way(summary["blocked"], record, ends)}
    if last is None:
        return summary
    summary = summary | {"ended_because": last.text}
    if summary["result"] in UNFINISHED:
        summary["result"] = ENDED
    return summary


def _in_the_way(
    episodes: list[dict[str, Any]], record: RunRecord, ends: list[TeamEnd]
) -> list[dict[str, Any]]:
    """Return the blocked requests, except those that began while the robots were leaving."""
    epoch_s = time.time() - boottime_us() / SECOND_US
    began_s = (record.started_us or 0) / SECOND_US + epoch_s

    def is_of_an_end(episode: dict[str, Any]) -> bool:
        from_s = began_s + (episode["from"] or 0.0)
        return any(
            end.unix_s - LEAVING_S <= from_s
            and (end.until_unix_s is None or from_s < end.until_unix_s)
            for end in ends
        )

    return [episode for episode in episodes if not is_of_an_end(episode)]
