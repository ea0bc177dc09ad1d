"""One job as an observer has seen it, and many of them in figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.records import JobState
from mrbt_mesh.observer.work_log import WorkSpan

OPEN = "open"


@dataclass(slots=True)
class JobHistory:
    """One job. Times are on the observer's clock, None if they passed before it watched.

    `priority`, `not_before_us`, `deadline_us` (Unix times, 0: none): None if it had ended before.
    `attempts`: how often its tree has begun. `worked`: the robots that have worked on it, `spans`:
    when. `holds`: when it was held, and until when. `is_older`: a part of this passed before it
    watched. `results`: the job's own entries of the blackboard that were set, as texts. `state`:
    None while it is open. `ready_us`: since when it could begin; `late_us`: how long after its
    deadline it ended. None: not known.
    """

    type: str = ""
    state: JobState | None = None
    ready_us: int | None = None
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
    spans: list[WorkSpan] = field(default_factory=list)
    holds: list[tuple[int, int | None]] = field(default_factory=list)
    is_older: bool = False
    results: dict[str, str] = field(default_factory=dict)
    _clock_offset_us: int | None = None

    def ends(self, state: JobState, robots: tuple[str, ...]) -> None:
        """It was cancelled, or a robot has written its end (`KnownJob.end` says which one counts):
        it is cancelled though others have done it all the same, and success overrules failure.
        """
        if self.state is None or (
            self.state is not JobState.CANCELLED
            and state in (JobState.CANCELLED, JobState.SUCCEEDED)
        ):
            self.state = state
        self.worked.update(robots)

    def at_work(self, span: WorkSpan) -> None:
        """A robot works on it, or is on its way; it may be told again."""
        if all(each is not span for each in self.spans):
            self.spans.append(span)

    def held(self, is_held: bool, at_us: int) -> None:
        """It is held or released from now on."""
        was_held = bool(self.holds) and self.holds[-1][1] is None
        if is_held and not was_held:
            self.holds.append((at_us, None))
        elif was_held and not is_held:
            self.holds[-1] = self.holds[-1][0], at_us

    def worked_us(self, ended_us: int | None) -> int | None:
        """For how long at least one robot worked on it until it ended; None: nobody did, or that is
        not known.
        """
        work = self._work(ended_us)
        if ended_us is None or not work or not self._is_known:
            return None
        return covered_us(work, min(begin for begin, _ in work), ended_us)

    def waited_us(self, ended_us: int | None) -> int | None:
        """For how long no robot worked on it though it could have, until it ended: it was due, and
        not held. None: that is not known.
        """
        if ended_us is None or self.ready_us is None or not self._is_known:
            return None
        ready_us = min(self.ready_us, ended_us)
        busy = [*self._work(ended_us), *_until(self.holds, ended_us)]
        return ended_us - ready_us - covered_us(busy, ready_us, ended_us)

    @property
    def _is_known(self) -> bool:
        """Whether all of it has happened while it was watched."""
        is_older = self.is_older or any(span.is_older for span in self.spans)
        return self.submitted_us is not None and not is_older

    def _work(self, ended_us: int | None) -> list[tuple[int, int]]:
        began = ((s.at_work_us, s.ended_us) for s in self.spans if s.at_work_us is not None)
        return _until(began, ended_us) if ended_us is not None else []

    def unix_us(self, name: str, clock_offset_us: int | None) -> int | None:
        """One of the times as a Unix time; None: it is not known.

        All of them by the clock that is so much ahead when one is asked for first.
        """
        at_us = getattr(self, f"{name}_us")
        if at_us is None or clock_offset_us is None:
            return None
        if self._clock_offset_us is None:
            self._clock_offset_us = clock_offset_us
        return int(at_us + self._clock_offset_us)


def _until(spans: Iterable[tuple[int, int | None]], end_us: int) -> list[tuple[int, int]]:
    """The same with this end for those that have none."""
    return [(begin, end_us if end is None else end) for begin, end in spans]


def covered_us(spans: Iterable[tuple[int, int]], from_us: int, to_us: int) -> int:
    """How much of the time between these two is in at least one of the spans."""
    covered = 0
    for begin, end in sorted(spans):
        begin, end = max(begin, from_us), min(end, to_us)
        if end > begin:
            covered, from_us = covered + end - begin, end
    return covered


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
    """All jobs of a type. `states`: the ends, and `open`. Of those that have ended, `waits`: for
    how long no robot worked on them though it could have; `works`: of those that were worked on,
    for how long; `delays`: of those that were done or failed after their deadlines, by how much.
    `robots`: how many jobs each has worked on.
    """

    states: Counter[str] = field(default_factory=Counter)
    waits: Times = field(default_factory=Times)
    works: Times = field(default_factory=Times)
    delays: Times = field(default_factory=Times)
    robots: Counter[str] = field(default_factory=Counter)

    def add(self, job: JobHistory, ended_us: int | None) -> None:
        """One more job; `ended_us`: None if it has not, or that is not known."""
        self.states[OPEN if job.state is None else str(job.state)] += 1
        self.waits.add(job.waited_us(ended_us))
        self.works.add(job.worked_us(ended_us))
        if job.late_us and job.state in (JobState.SUCCEEDED, JobState.FAILED):
            self.delays.add(job.late_us)
        self.robots.update(job.worked)
