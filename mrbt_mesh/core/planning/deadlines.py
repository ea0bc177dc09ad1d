"""Deadlines that become facts: of Timeouts, of tasks that are blocked or about to fail, of what
dead robots had, of what features wait for.

Every robot measures from when it first saw the thing run, and starts again if it saw it stop. The
first robot that sees the deadline pass writes the fact; others have to confirm that a task has
failed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import TypeAlias

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import LATCH
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.job_ends import job_ends
from mrbt_mesh.core.planning.plan import Plan

# A fact, and whether it follows from the alive set: then the others have to agree.
Due: TypeAlias = tuple[str, bool]


class Deadlines:
    """The deadlines that are running, by what they will become.

    `failure_latch_us`: how long a failure is pending where the mission does not name a time; a loss
    is pending as long. `detection_us`: the detection time, by which features measure.
    """

    def __init__(self, detection_us: int, failure_latch_us: int) -> None:
        self._detection_us = detection_us
        self._failure_latch_us = failure_latch_us
        self._due_us: dict[Due, int] = {}
        # They have passed, but the others do not agree.
        self._held: set[Due] = set()

    def expired(
        self,
        plan: Plan,
        facts: TeamFacts,
        now_us: int,
        is_agreed: Callable[[], bool],
        claimed: Collection[str] = (),
    ) -> list[Fact]:
        """Follow a plan; returns the facts to write for deadlines that have passed.

        `is_agreed`: whether all robots in good standing report this plan. `claimed`: names of facts
        that others have written for deadlines, which so have agreed.
        """
        pending = plan.pending_failures or plan.pending_losses
        ended = plan.evaluation.job_ends
        if not (plan.evaluation.timeouts or plan.waiting or pending or ended or self._due_us):
            return []
        before, self._due_us = self._due_us, {}
        for due, limit_us in self._running(plan, facts).items():
            self._due_us[due] = before.get(due, now_us + limit_us)
        passed = {due for due, at_us in self._due_us.items() if at_us <= now_us}
        agreed_on = {due for due in passed if due[1] and due[0] not in claimed}
        self._held = set() if not agreed_on or is_agreed() else agreed_on
        losses = dict(loss.fact for loss in plan.pending_losses)
        others = losses | dict(job_ends(facts, plan.evaluation))
        names = sorted({name for name, _ in passed - self._held})
        return [(name, others.get(name, LATCH)) for name in names]

    def _running(self, plan: Plan, facts: TeamFacts) -> dict[Due, int]:
        """What runs now, and for how long at most, in microseconds."""
        running: dict[Due, int] = {
            (f"{records.EXPIRED}/{t.activation}", False): t.timeout_us
            for t in plan.evaluation.timeouts
        }
        for waiting in plan.waiting:
            limit_us = facts.mission.global_tasks[waiting.global_task].blocked_fail_after_us
            if waiting.shortages and limit_us is not None:
                running[f"{records.LATCHED_FAILURE}/{waiting.activation}", False] = limit_us
        for failure in plan.pending_failures:
            after_us = failure.after_us
            limit_us = self._failure_latch_us if after_us is None else after_us
            running[failure.fact_name, True] = limit_us
        for loss in plan.pending_losses:
            running[loss.fact[0], True] = self._failure_latch_us
        for job in plan.evaluation.job_ends:  # the robots whose turn it is have not written it
            name = f"{records.JOB_END}/{job.job}"
            if facts.map.get(facts.me, name) is None:
                running[name, False] = self._failure_latch_us
        for part in plan.parts.values():
            for name, limit_us in part.deadlines(self._detection_us).items():
                running[name, False] = limit_us
        return running

    def left_us(self, now_us: int) -> dict[Due, int]:
        """How long each has yet to run."""
        return {due: at_us - now_us for due, at_us in self._due_us.items()}

    def resume(self, left_us: Mapping[Due, int], now_us: int) -> None:
        """These have yet to run for so long."""
        self._due_us = {due: now_us + each_us for due, each_us in left_us.items()}

    def restart_agreed(self) -> None:
        """This robot has not known the alive set for a while."""
        self._due_us = {due: at_us for due, at_us in self._due_us.items() if not due[1]}
        self._held.clear()

    @property
    def awaits_agreement(self) -> bool:
        """Whether one has passed that becomes a fact as soon as all report the same plan."""
        return bool(self._held)

    def next_deadline_us(self) -> int | None:
        """The next one, of those that do not await agreement."""
        times_us = (at_us for due, at_us in self._due_us.items() if due not in self._held)
        return min(times_us, default=None)
