"""Problems that robots' processes note in the run directory because they cannot tell the team.

These are what blocks their event loops, and why they have died.
"""

from __future__ import annotations

from mrbt_mesh.core.facts.records import PROCESS
from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.runtime.blocked_loop import SUBJECT
from mrbt_mesh.runtime.run_dir import RunDir


def take_noted_problems(run_dir: RunDir, record: RunRecord, now_us: int) -> bool:
    """Add them to the record of a run; return whether there are any."""
    blocked = {robot: run_dir.blocked(robot) for robot in run_dir.blocked_robots()}
    died = {robot: run_dir.last_words(robot) for robot in run_dir.died_robots()}
    found = [(robot, SUBJECT, text) for robot, text in blocked.items() if text]
    found += [(robot, PROCESS, text) for robot, text in died.items() if text]
    for robot, subject, text in found:
        record.problem(robot, subject, text, now_us)
    for robot, subject in list(record.problems):
        if subject == PROCESS and not died.get(robot):
            record.problem(robot, PROCESS, "", now_us)  # it was started again
    return bool(found)
