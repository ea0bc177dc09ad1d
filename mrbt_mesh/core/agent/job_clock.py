"""When jobs become due, and when they expire: wall-clock times that become facts.

The first robot that sees a time pass writes the fact for all, provided that its clock is believed.
"""

from __future__ import annotations

import heapq

from mrbt_mesh.core.agent.wall_clock import WallClock
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.jobs import Jobs
from mrbt_mesh.core.facts.records import LATCH, JobState
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.job_ends import job_end


class JobClock:
    """The start times and deadlines of the jobs that one robot knows."""

    def __init__(self, facts: TeamFacts, clock: WallClock) -> None:
        self._facts = facts
        self._clock = clock
        # (Unix time, job, whether it expires then). The job may have ended meanwhile.
        self._times: list[tuple[int, str, bool]] = []

    @property
    def _jobs(self) -> Jobs:
        """The present index, which is replaced when a key is revoked or a revision is adopted."""
        assert self._facts.jobs is not None
        return self._facts.jobs

    def passed(self, now_us: int) -> list[Fact]:
        """The facts to write for all times that have passed."""
        for name in self._jobs.arrived:
            known = self._jobs.known.get(name)
            job = known.job if known is not None else None
            if job is not None and job.not_before_us:
                heapq.heappush(self._times, (job.not_before_us, name, False))
            if job is not None and job.deadline_us:
                heapq.heappush(self._times, (job.deadline_us, name, True))
        self._jobs.arrived.clear()
        found: list[Fact] = []
        while (at_us := self.next_deadline_us()) is not None and at_us <= now_us:
            found += self._fact(*heapq.heappop(self._times))
        return found

    def next_deadline_us(self) -> int | None:
        """When the next time passes. Also None while the robot's clock is not believed."""
        return self._clock.when_us(self._times[0][0]) if self._times else None

    def _fact(self, at_us: int, name: str, expires: bool) -> list[Fact]:
        known = self._jobs.known.get(name)
        if known is None or known.job is None or known.end is not None:
            return []
        if at_us != (known.job.deadline_us if expires else known.job.not_before_us):
            return []  # of a later submission under the same id
        if not expires:
            return [] if known.is_due else [(f"{records.JOB_DUE}/{name}", LATCH)]
        end = job_end(self._facts, known, JobState.EXPIRED, "its deadline has passed")
        return [(f"{records.JOB_END}/{name}", end)]
