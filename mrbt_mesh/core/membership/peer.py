"""What one robot knows of another one, and how regularly news of it arrives."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, Position, SelfReport

# A robot that was never heard before: one heartbeat in four is assumed lost.
PRIOR_PERIODS = 4
# Older experience counts for less: both sums are halved when they cover that many periods.
MEMORY_PERIODS = 128


class State(enum.StrEnum):
    """A robot as another one sees it. LEFT: it left the team on purpose.

    `is_healthy`: alive, not suspect. `is_member`: healthy or suspect, so neither dead nor left.
    `is_suspected`: suspect or dead.
    """

    ALIVE = "alive"
    SUSPECT = "suspect"
    DEAD = "dead"
    LEFT = "left"

    # Read with every message; members of an enumeration are slow to look up.
    def __init__(self, name: str) -> None:
        self.is_healthy = name == "alive"
        self.is_member = name in ("alive", "suspect")
        self.is_suspected = name in ("suspect", "dead")


@dataclass(slots=True)
class ArrivalHistory:
    """Sums over the intervals between pieces of news of one robot, whichever way they came.

    `observed_us`: all of them. `overdue_us`: what each was longer than 5/4 of a heartbeat period.
    The share of time in which news was overdue needs no assumed distribution, and repeats that
    follow one another quickly do not dilute it.

    Source: the phi accrual failure detector (Hayashibara, Defago, Yared, Katayama 2004), which
    also derives a timeout from measured arrivals.
    """

    observed_us: int
    overdue_us: int

    @staticmethod
    def of_new_robot(timing: Timing) -> ArrivalHistory:
        """Of a robot that was never heard before."""
        return ArrivalHistory(PRIOR_PERIODS * timing.heartbeat_us, timing.heartbeat_us)

    def add_interval(self, interval_us: int, timing: Timing) -> None:
        """News came `interval_us` after the news before."""
        self.observed_us += interval_us
        self.overdue_us += max(0, interval_us - timing.overdue_us)
        if self.observed_us > MEMORY_PERIODS * timing.heartbeat_us:
            self.observed_us //= 2
            self.overdue_us //= 2

    @property
    def overdue_permille(self) -> int:
        """The share of the time in which news was overdue, rounded up."""
        return -(-1_000 * self.overdue_us // self.observed_us)


@dataclass(slots=True)
class Peer:
    """What is known of one robot's newest incarnation.

    `report`: its newest self-report, from its own heartbeat or relayed; it arrived at
    `last_heard_us`. After `probe_after_us` of silence the robot is suspected and probed, after
    `silence_limit_us` it is dead. `heartbeat`, `position`: the last that it sent itself.
    `clock_offset_us`: what its wall clock showed then, minus `last_heard_us`, or None.
    `beat_us`: when its last own heartbeat arrived. `returned_us`: when it was heard first, or again
    after it was dead.
    `is_judged`: this robot judges its silence. `token_lost_by`: robots that lost its liveliness
    token, as this one did if `is_token_lost`. `declared_dead_by`: those that declared it dead.
    """

    incarnation: Incarnation
    report: SelfReport
    last_heard_us: int
    arrivals: ArrivalHistory
    silence_limit_us: int
    probe_after_us: int
    heartbeat: Heartbeat | None = None
    position: Position | None = None
    clock_offset_us: int | None = None
    beat_us: int = 0
    returned_us: int = 0
    is_judged: bool = False
    is_probed: bool = False
    is_token_lost: bool = False
    state: State = State.ALIVE
    token_lost_by: set[str] = field(default_factory=set)
    declared_dead_by: set[str] = field(default_factory=set)


def set_member(names: set[str], name: str, is_member: bool) -> bool:
    """Put a name into a set or take it out; whether that changed anything."""
    is_new = (name in names) is not is_member
    if is_new:
        (names.add if is_member else names.discard)(name)
    return is_new
