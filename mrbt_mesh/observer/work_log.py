"""The work of every robot: its claims, their times and how they ended."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from mrbt_mesh.core.facts.records import Claim, Outcome, Phase
from mrbt_mesh.observer.newest import Newest

# Messages take less, and a moment that moves with each of them is no moment.
SAME_US = 500_000


class WorkEnd(enum.StrEnum):
    """How a robot's work on a local task ended. DROPPED: it or a newer plan gave it up."""

    DONE = "done"
    FAILED = "failed"
    DROPPED = "dropped"
    DIED = "died"


@dataclass(slots=True)
class WorkSpan:
    """One claim of a robot. `at_work_us`: when it set out for its place, or stood ready there;
    `running_us`: when its action began. None: not (yet).

    `is_older`: it began before the run was watched; by its robot's word its action began at
    `begun_us`. `reason`: why it failed, if that is known. `is_way`: the robot had to go to its
    place first.
    """

    robot: str
    activation: str
    global_task: str
    local_task: str
    claimed_us: int
    at_work_us: int | None = None
    running_us: int | None = None
    ended_us: int | None = None
    end: WorkEnd | None = None
    is_older: bool = False
    reason: str = ""
    is_way: bool = False
    begun_us: int | None = None

    @property
    def since_us(self) -> int | None:
        """When its action began; None: not (yet), or it is not known."""
        return self.begun_us if self.is_older else self.running_us

    def is_of(self, activation: str, local_task: str) -> bool:
        """Whether it is work on this local task of this activation."""
        return (self.activation, self.local_task) == (activation, local_task)


class WorkLog:
    """The spans in the order of their claims. One that has ended changes only if its outcome is
    heard after the end of its claim.
    """

    def __init__(self, limit: int | None = None) -> None:
        self.spans = Newest[WorkSpan](limit, self.is_settled)
        self._latest: dict[str, WorkSpan] = {}

    def is_settled(self, span: WorkSpan) -> bool:
        """Whether it changes no more: it has ended, and its robot has gone on to other work."""
        return span.ended_us is not None and self._latest.get(span.robot) is not span

    def claimed(self, robot: str, claim: Claim, now_us: int, is_older: bool = False) -> WorkSpan:
        """A living robot holds this claim; `is_older`: it began before the run was watched."""
        span = self._latest.get(robot)
        if (
            span is None
            or span.ended_us is not None
            or not span.is_of(claim.activation, claim.local_task)
        ):
            self._end(robot, WorkEnd.DROPPED, now_us)
            span = WorkSpan(robot, claim.activation, claim.global_task, claim.local_task, now_us)
            span.is_older = is_older
            self._latest[robot] = span
            self.spans.append(span)
        span.is_way = span.is_way or claim.phase is Phase.TRAVELLING
        if claim.phase is not Phase.CLAIMED and span.at_work_us is None:
            span.at_work_us = now_us
        if claim.phase is Phase.RUNNING and span.running_us is None:
            span.running_us = now_us
        return span

    def goes_on(self, robot: str, work_ms: int, now_us: int) -> None:
        """The robot's action runs for so long by now, as it says."""
        span = self._latest.get(robot)
        if span is None or not span.is_older or span.ended_us is not None or not work_ms:
            return
        begun_us = now_us - work_ms * 1_000
        if span.begun_us is None or abs(span.begun_us - begun_us) > SAME_US:
            span.begun_us = begun_us

    def latest(self, robot: str) -> WorkSpan | None:
        """The robot's last claim, over or not; None before its first."""
        return self._latest.get(robot)

    def given_up(self, robot: str, now_us: int) -> None:
        """The robot holds nothing any more."""
        self._end(robot, WorkEnd.DROPPED, now_us)

    def outcome(
        self, robot: str, activation: str, local_task: str, outcome: Outcome, now_us: int
    ) -> None:
        """The robot has ended; the end of its claim may have been heard before."""
        end = WorkEnd.DONE if outcome.success else WorkEnd.FAILED
        span = self._latest.get(robot)
        if span is not None and span.is_of(activation, local_task):
            if span.ended_us is None:
                self._end(robot, end, now_us)
            elif span.end is WorkEnd.DROPPED:
                span.end = end
            span.reason = outcome.reason

    def died(self, robot: str, at_us: int) -> None:
        """The robot's life ended then; it may be called again with a better time."""
        span = self._latest.get(robot)
        if span is not None and (span.ended_us is None or span.end is WorkEnd.DIED):
            span.ended_us, span.end = max(at_us, span.claimed_us), WorkEnd.DIED

    def _end(self, robot: str, end: WorkEnd, now_us: int) -> None:
        span = self._latest.get(robot)
        if span is not None and span.ended_us is None:
            span.ended_us, span.end = now_us, end
