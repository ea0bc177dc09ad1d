"""Which jobs this robot's journal holds, and the queries that are answered once it does."""

from __future__ import annotations

from collections.abc import Iterable

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.replica import Durability

# Of more queries than that the oldest are forgotten: their clients ask again.
MAX_WAITING = 1_000


class JobsOnDisk:
    """The jobs of one robot's facts, as far as its journal is known to hold them."""

    def __init__(self, facts: TeamFacts, durability: Durability) -> None:
        self._facts = facts
        self._durability = durability
        # The number by which to know when the newest facts of a job are on disk.
        self._numbers: dict[str, int] = {}
        # The job and the stamp that a query waits for.
        self._waiting: dict[int, tuple[str, int]] = {}

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

    def wait(self, query: int, job: str, stamp: int) -> None:
        """This query is to be answered once all facts of a job up to the stamp are on disk.

        A robot that has not heard of a change yet has not kept it.
        """
        self._waiting[query] = job, stamp
        if len(self._waiting) > MAX_WAITING:
            del self._waiting[min(self._waiting)]

    def take_answered(self) -> list[int]:
        """The queries that are to be answered now, each once."""
        found = [query for query, awaited in self._waiting.items() if self._holds(*awaited)]
        for query in found:
            del self._waiting[query]
        return found

    def _holds(self, job: str, stamp: int) -> bool:
        jobs, durability = self._facts.jobs, self._durability
        if jobs is None or not durability.may_promise:
            return False
        known = jobs.known.get(job)
        if known is None or known.stamp < stamp:
            return jobs.is_archived(job)
        return durability.is_on_disk(self._numbers.get(job, 0))
