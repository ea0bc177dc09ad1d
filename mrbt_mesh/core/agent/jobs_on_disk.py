"""Which jobs this robot's journal holds, and the queries that are answered once it does."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.replica import Durability

# Of more queries than that the oldest are forgotten: their clients ask again.
MAX_WAITING = 1_000


class AwaitedJob(NamedTuple):
    """A job, all facts of which up to this stamp are to be on disk.

    A robot that has not heard of a change yet has not kept it.
    """

    id: str
    stamp: int


class JobsOnDisk:
    """The jobs of one robot's facts, as far as its journal is known to hold them."""

    def __init__(self, facts: TeamFacts, durability: Durability) -> None:
        self._facts = facts
        self._durability = durability
        # The number by which to know when the newest facts of a job are on disk.
        self._numbers: dict[str, int] = {}
        # By query; the oldest first.
        self._waiting: dict[int, AwaitedJob] = {}

    def note(self, job: str, number: int) -> None:
        """The newest facts of a job are on disk once this number is."""
        self._numbers[job] = number

    def forget(self, dropped: Iterable[tuple[str, str]]) -> None:
        """These facts, by author and name, were dropped: of some jobs nothing is known any more."""
        jobs = self._facts.jobs
        for _, name in dropped if jobs is not None else ():
            kind, _, job = name.partition("/")
            if jobs is not None and kind in records.JOB_KINDS and job not in jobs.known:
                self._numbers.pop(job, None)

    def wait(self, query: int, job: AwaitedJob) -> None:
        """This query is to be answered once a job is on disk."""
        self._waiting[query] = job
        if len(self._waiting) > MAX_WAITING:
            del self._waiting[next(iter(self._waiting))]

    def take_answered(self) -> list[int]:
        """The queries that are to be answered now, each once."""
        found = [query for query, job in self._waiting.items() if self._holds(job)]
        for query in found:
            del self._waiting[query]
        return found

    def _holds(self, job: AwaitedJob) -> bool:
        jobs, durability = self._facts.jobs, self._durability
        if jobs is None or not durability.may_promise:
            return False
        known = jobs.known.get(job.id)
        if known is None or known.stamp < job.stamp:
            return jobs.is_archived(job.id)
        return durability.is_on_disk(self._numbers.get(job.id, 0))
