"""Parts of a run's record: faults, failures, blocked requests and biddings, with their times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Incarnation


@dataclass(slots=True)
class MajorFault:
    """A robot's death: when it died, its claim, when it was declared dead and when it was replaced.

    `exact`: its time is that of the process's end. `is_older`: it happened before the run was
    watched, so its times are not known.
    """

    robot: str
    incarnation: Incarnation
    at_us: int
    held: Claim | None
    detected_us: int | None = None
    reassigned_us: int | None = None
    replacement: str | None = None
    until_us: int | None = None
    exact: bool = False
    is_older: bool = False


@dataclass(slots=True)
class MinorFault:
    """Capabilities that a robot has lost, for one reason; empty if none was given."""

    robot: str
    local_tasks: tuple[str, ...]
    reason: str
    at_us: int
    until_us: int | None = None


@dataclass(slots=True)
class ProblemEpisode:
    """A time during which something was wrong with a robot's journal, or a part of its program."""

    problem: str
    from_us: int
    to_us: int | None = None


def lost_text(local_tasks: Iterable[str], reason: str) -> str:
    """A minor fault in words."""
    return f"lost {', '.join(local_tasks)}" + (f": {reason}" if reason else "")


@dataclass(frozen=True, slots=True)
class FailedEnd:
    """A robot has failed at a local task; `reason`: that of its program, or empty.

    `at_us`: None if it had failed before the run was watched.
    """

    robot: str
    global_task: str
    local_task: str
    at_us: int | None
    reason: str


@dataclass(slots=True)
class BlockedEpisode:
    """A time during which a request could not be served by any living robots."""

    request: str
    reason: str
    from_us: int
    to_us: int | None = None


@dataclass(slots=True)
class BiddingRecord:
    """The bids for a local task of one activation, in units, and the robots that ran it.

    None: the robot has no bid.
    """

    global_task: str
    local_task: str
    at_us: int
    bids: dict[str, float | None] = field(default_factory=dict)
    robots: set[str] = field(default_factory=set)
