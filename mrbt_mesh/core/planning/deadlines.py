"""Deadlines that become facts: of the tree's Timeouts, of global tasks that are blocked, of bids.

Every robot measures from when it first saw the thing run; whoever sees the deadline pass
first says so, once, for all.
"""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.plan import Plan


class Deadlines:
    """The deadlines that are running, by the name of the fact that they will become.

    `bid_us`: how long bids are waited for where the mission does not say.
    """

    def __init__(self, bid_us: int) -> None:
        self._bid_us = bid_us
        self._due_us: dict[str, int] = {}

    def expired(self, plan: Plan, facts: TeamFacts, now_us: int) -> list[tuple[str, Any]]:
        """Follow a plan; returns the facts to write for deadlines that have passed."""
        if not (plan.evaluation.timeouts or plan.waiting or self._due_us):
            return []
        running = {
            f"{records.EXPIRED}/{t.activation}": t.timeout_us for t in plan.evaluation.timeouts
        }
        for waiting in plan.waiting:
            limit_us = facts.mission.global_tasks[waiting.global_task].blocked_fail_after_us
            if waiting.shortages and limit_us is not None:
                running[f"{records.VERDICT}/{waiting.activation}"] = limit_us
        for bidding in plan.biddings:
            if bidding.is_open:
                within_us = bidding.within_us
                running[bidding.closed_name] = self._bid_us if within_us is None else within_us
        due_us = {}
        for name, limit_us in running.items():
            due_us[name] = self._due_us.get(name, now_us + limit_us)
        self._due_us = due_us
        return [(name, True) for name in sorted(due_us) if due_us[name] <= now_us]

    def next_deadline_us(self) -> int | None:
        return min(self._due_us.values(), default=None)
