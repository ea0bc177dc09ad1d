"""Which facts about coalitions a mission has a place for."""

from __future__ import annotations

from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.mission.mission import GlobalTask
from mrbt_mesh.features.exclusive.kinds import CLEARED, COALITION, EXCLUSIVE_KINDS
from mrbt_mesh.features.exclusive.records import Coalition, CoalitionId


def id_problem(text: str) -> str:
    """What is wrong with the id of a coalition; empty: nothing."""
    try:
        CoalitionId.parse(text)
    except ValueError:
        return f"{text!r:.80} names no coalition"
    return ""


def refuses(entry: Entry, task: GlobalTask) -> str:
    """Why an activation of this global task has no place for a fact about a coalition."""
    kind, text = entry.parts[0], entry.parts[-1]
    if kind in EXCLUSIVE_KINDS and not task.at_most_once:
        return f"{task.id!r} is not exclusive"
    if task.joint is None:
        return f"{task.id!r} has no coalitions"
    if problem := id_problem(text):
        return problem
    leader = CoalitionId.parse(text).leader
    if kind in (COALITION, CLEARED) and entry.author != leader:
        return f"{text!r:.80}: {kind} is for {leader} to write"
    if isinstance(entry.record, Coalition):
        known = {need.local_task for need in task.needs}
        others = [m.local_task for m in entry.record.members if m.local_task not in known]
        return f"{text!r:.80}: {others[0]!r:.80} is not needed" if others else ""
    return ""
