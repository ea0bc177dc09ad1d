"""When jobs become due, and when they expire: deadlines that become facts.

Every robot measures from when it first knew of a job; the first that sees the time pass writes the
fact, for all. A robot that starts again measures anew, so a job may be late, and is never early.
"""

from __future__ import annotations

import heapq

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.jobs import Jobs
from mrbt_mesh.core.facts.records import LATCH, JobState
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.job_ends import job_end, robots_of


class JobClock:
    """The delays and deadlines of the jobs that one robot knows."""

    def __init__(self, facts: TeamFacts, jobs: Jobs) -> None:
        self._facts = facts
        self._jobs = jobs
        # (time, job, whether it expires then); it may have ended meanwhile.
        self._times: list[tuple[int, str, bool]] = []

    def passed(self, now_us: int) -> list[Fact]:
        """The facts to write for all times that have passed."""
        for name in self._jobs.arrived:
            known = self._jobs.known.get(name)
            job = known.job if known is not None else None
            if job is not None and job.delay_us:
                heapq.heappush(self._times, (now_us + job.delay_us, name, False))
            if job is not None and job.deadline_us:
                heapq.heappush(self._times, (now_us + job.deadline_us, name, True))
        self._jobs.arrived.clear()
        found: list[Fact] = []
        while self._times and self._times[0][0] <= now_us:
            _, name, expires = heapq.heappop(self._times)
            found += self._fact(name, expires)
        return found

    def next_deadline_us(self) -> int | None:
        """When the next one passes."""
        return self._times[0][0] if self._times else None

    def _fact(self, name: str, expires: bool) -> list[Fact]:
        known = self._jobs.known.get(name)
        if known is None or known.job is None or known.end is not None:
            return []
        if not expires:
            return [] if known.is_due else [(f"{records.JOB_DUE}/{name}", LATCH)]
        stamp = self._facts.max_stamp + 1
        robots = robots_of(self._facts, name)
        end = job_end(known.job, JobState.EXPIRED, "its deadline has passed", robots, stamp)
        return [(f"{records.JOB_END}/{name}", end)]
