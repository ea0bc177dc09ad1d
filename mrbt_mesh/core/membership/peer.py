"""What one robot knows of another one, and how regularly news of it arrives."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, Position, SelfReport

# Prior for a robot that was never heard before: one heartbeat in four is lost.
PRIOR_PERIODS = 4
# Older experience counts less: both sums are halved once they cover this many periods.
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

    # Attributes, as they are read for every message and enumeration members are slow to compare.
    def __init__(self, name: str) -> None:
        self.is_healthy = name == "alive"
        self.is_member = name in ("alive", "suspect")
        self.is_suspected = name in ("suspect", "dead")


@dataclass(slots=True)
class ArrivalHistory:
    """Sums over the intervals between reports of one robot, own or relayed.

    `observed_us`: the sum of all intervals. `overdue_us`: the sum of the excess of each over 5/4 of
    a heartbeat period. Their ratio, the share of time in which news was overdue, assumes no
    distribution and is not diluted by repetitions in quick succession.

    Source: the phi accrual failure detector (Hayashibara, Defago, Yared, Katayama 2004), which also
    derives a timeout from measured arrivals.
    """

    observed_us: int
    overdue_us: int

    @staticmethod
    def of_new_robot(timing: Timing) -> ArrivalHistory:
        """The prior for a robot that was never heard before."""
        return ArrivalHistory(PRIOR_PERIODS * timing.heartbeat_us, timing.heartbeat_us)

    def add_interval(self, interval_us: int, timing: Timing) -> None:
        """Add the interval between two consecutive reports."""
        self.observed_us += interval_us
        self.overdue_us += max(0, interval_us - timing.overdue_us)
        if self.observed_us > MEMORY_PERIODS * timing.heartbeat_us:
            self.observed_us //= 2
            self.overdue_us //= 2

    @property
    def overdue_permille(self) -> int:
        """The share of time in which news was overdue, in thousandths, rounded up."""
        return -(-1_000 * self.overdue_us // self.observed_us)


@dataclass(slots=True)
class Peer:
    """What is known of one robot's newest incarnation.

    `report`: its newest self-report, from its own heartbeat or relayed, which arrived at
    `last_heard_us`. After `probe_after_us` of silence the robot is suspected and probed; after
    `silence_limit_us` it is dead. `heartbeat`, `position`: the last ones that it sent itself.
    `clock_offset_us`: its wall clock at that time minus `last_heard_us`, or None. `beat_us`: when
    its last own heartbeat arrived. `returned_us`: when it was first heard, or heard again after it
    was dead. `is_judged`: this robot judges its silence. `is_token_lost`: this robot lost its
    liveliness token. `token_lost_by`: other robots that did. `declared_dead_by`: robots that
    declared it dead.
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
    """Add a name to a set or remove it. Returns whether that changed anything."""
    is_new = (name in names) is not is_member
    if is_new:
        (names.add if is_member else names.discard)(name)
    return is_new
