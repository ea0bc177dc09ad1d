"""For how long robots have been at their work, how long it should take, and how that is told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import performance
from mrbt_mesh.observer.observer import Observer

# Work that takes more than this many times as long as it should is late.
_LATE_FACTOR = 3


@dataclass(frozen=True, slots=True)
class TimeAtWork:
    """The work of one robot on a local task, in s.

    `since_us`: when it began. `expected_s`: the local task's `work`, by the robot's performance and
    the speed of simulated robots; None where the mission does not say how long it takes.
    """

    robot: str
    local_task: str
    since_us: int
    for_s: float
    expected_s: float | None

    @property
    def is_overdue(self) -> bool:
        """Whether it takes far longer than it should."""
        limit_s = late_after_s(self.expected_s)
        return limit_s is not None and self.for_s > limit_s


def late_after_s(expected_s: float | None) -> float | None:
    """Work that has taken longer than this is late; None: it is not known how long it should take.

    Views that show time as it passes compare with it themselves.
    """
    return None if expected_s is None else _LATE_FACTOR * expected_s


def time_text(for_s: float, expected_s: float | None) -> str:
    """`42 s of 5 s`: for how long work goes on, and how long it should take, if that is known."""
    text = duration_text(for_s)
    return text if expected_s is None else f"{text} of {duration_text(expected_s)}"


def duration_text(seconds: float) -> str:
    """A duration that is told again and again: `0.5 s`, `42 s`, `3 min`, `2 h 5 min`."""
    if seconds < 10:
        return f"{seconds:.1f} s".replace(".0 ", " ")
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    hours, minutes = divmod(minutes, 60)
    if not hours:
        return f"{minutes} min"
    return f"{hours} h {minutes} min" if minutes else f"{hours} h"


def time_at_work(observer: Observer, robot: str, now_us: int) -> TimeAtWork | None:
    """Of the action that a robot runs now; None if it runs none, or if that is not known."""
    claim, span = observer.claim(robot), observer.record.work_log.latest(robot)
    if claim is None or claim.phase is not Phase.RUNNING or span is None:
        return None
    since_us = span.since_us
    if since_us is None or not span.is_of(claim.activation, claim.local_task):
        return None
    for_s = max(0, now_us - since_us) / SECOND_US
    expected_s = _expected_s(observer, robot, claim.local_task)
    return TimeAtWork(robot, claim.local_task, since_us, for_s, expected_s)


def overdue(observer: Observer, now_us: int) -> Iterator[TimeAtWork]:
    """The robots whose work takes far longer than it should, the longest first."""
    found = [time_at_work(observer, robot, now_us) for robot in observer.robots()]
    late = [each for each in found if each is not None and each.is_overdue]
    yield from sorted(late, key=lambda each: (each.since_us, each.robot))


def _expected_s(observer: Observer, robot: str, local_task: str) -> float | None:
    work, known = observer.mission.declared_work(local_task), observer.facts.members.get(robot)
    able = performance(known.member.capabilities, local_task) if known is not None else None
    return work / able / observer.speed if work is not None and able else None
