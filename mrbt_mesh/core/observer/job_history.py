"""One job as an observer has seen it, and many of them in figures."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.records import JobState

OPEN = "open"


@dataclass(slots=True)
class JobHistory:
    """One job. Times are on the observer's clock, None if they passed before it watched.

    `priority`, `not_before_us`, `deadline_us` (Unix times, 0: none): None if it had ended before.
    `attempts`: how often its tree has begun. `worked`: the robots that have worked on it.
    `results`: the job's own entries of the blackboard that were set, as texts. `state`: None while
    it is open. `robots`: those that have worked on it, once it has ended. `wait_us`: from when it
    could begin until it did; `late_us`: how long after its deadline it ended. None: not known.
    """

    type: str = ""
    state: JobState | None = None
    robots: tuple[str, ...] = ()
    wait_us: int | None = None
    late_us: int | None = None
    submitted_us: int | None = None
    begun_us: int | None = None
    ended_us: int | None = None
    has_begun: bool = False
    has_ended: bool = False
    priority: int | None = None
    not_before_us: int | None = None
    deadline_us: int | None = None
    attempts: int = 0
    worked: set[str] = field(default_factory=set)
    results: dict[str, str] = field(default_factory=dict)
    _unix: dict[str, int] = field(default_factory=dict)

    def ends(self, state: JobState, robots: tuple[str, ...]) -> None:
        """It was cancelled, or a robot has written its end (`KnownJob.end` says which one counts):
        it is cancelled though others have done it all the same, and success overrules failure.
        """
        if self.state is None or (
            self.state is not JobState.CANCELLED
            and state in (JobState.CANCELLED, JobState.SUCCEEDED)
        ):
            self.state = state
        self.robots = self.robots or robots

    def unix_us(self, name: str, clock_offset_us: int | None) -> int | None:
        """One of the times as a Unix time, by the clock that is so much ahead when it is asked for
        first; None: it is not known.
        """
        at_us = getattr(self, f"{name}_us")
        if at_us is None or clock_offset_us is None:
            return None
        return self._unix.setdefault(name, at_us + clock_offset_us)


@dataclass(slots=True)
class Times:
    """Of so many jobs: how long something took, in all and at most."""

    count: int = 0
    all_us: int = 0
    most_us: int = 0

    def add(self, us: int | None) -> None:
        """One more; None: it is not known."""
        if us is not None:
            self.count += 1
            self.all_us += us
            self.most_us = max(self.most_us, us)


@dataclass(slots=True)
class JobTotals:
    """All jobs of a type. `states`: the ends, and `open`. `waits`: from when they could begin until
    they did; `works`: from then until their ends; `delays`: of those that were done or failed
    after their deadlines, by how much. `robots`: how many jobs each has worked on.
    """

    states: Counter[str] = field(default_factory=Counter)
    waits: Times = field(default_factory=Times)
    works: Times = field(default_factory=Times)
    delays: Times = field(default_factory=Times)
    robots: Counter[str] = field(default_factory=Counter)

    def add(self, job: JobHistory) -> None:
        """One more job."""
        self.states[OPEN if job.state is None else str(job.state)] += 1
        self.waits.add(job.wait_us)
        if job.begun_us is not None and job.ended_us is not None:
            self.works.add(job.ended_us - job.begun_us)
        if job.late_us and job.state in (JobState.SUCCEEDED, JobState.FAILED):
            self.delays.add(job.late_us)
        self.robots.update(job.robots)
