"""Parts of a run's record: faults, failures, blocked requests, with their times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Incarnation


@dataclass(frozen=True, slots=True)
class DeathTimes:
    """When a robot died, when the first other one declared it dead, and when its replacement
    began; None: not (yet). `exact`: the first is the time of its process's end, not of the last
    sign of life.
    """

    at_us: int
    detected_us: int | None
    reassigned_us: int | None
    replacement: str | None
    exact: bool


# As a robot knows nobody when it joins, its first plan may lack robots for this long.
BRIEF_US = 100_000


@dataclass(slots=True)
class MajorFault:
    """A robot's death: its claim, and its times as `DeathTimes` has them.

    `is_older`: it happened before the run was watched, or unseen, so its times are not known.
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

    @property
    def times(self) -> DeathTimes:
        """Its times, for those who record them."""
        return DeathTimes(
            self.at_us, self.detected_us, self.reassigned_us, self.replacement, self.exact
        )

    @times.setter
    def times(self, known: DeathTimes) -> None:
        self.at_us, self.exact = known.at_us, known.exact
        self.detected_us, self.reassigned_us = known.detected_us, known.reassigned_us
        self.replacement = known.replacement

    @property
    def detected_after_us(self) -> int | None:
        """From the death until it was detected."""
        return None if self.detected_us is None else max(0, self.detected_us - self.at_us)

    @property
    def reassigned_after_us(self) -> int | None:
        """From the death until the replacement began."""
        return None if self.reassigned_us is None else max(0, self.reassigned_us - self.at_us)


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


def after_text(after_us: int, exact: bool) -> str:
    """How long after a death something happened; not `exact`: as the observer saw it."""
    if after_us < 10_000:
        text = f"{after_us / 1e3:.1f} ms"
    elif after_us < 1_000_000:
        text = f"{after_us / 1e3:.0f} ms"
    elif after_us < 10_000_000:
        text = f"{after_us / 1e6:.2f} s"
    else:
        text = f"{after_us / 1e6:.1f} s"
    return text if exact else f"about {text}"


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
    """A time during which a request could not be served by any living robots.

    `is_brief`: it was over sooner than robots that join hear of one another.
    """

    request: str
    reason: str
    from_us: int
    to_us: int | None = None

    @property
    def is_brief(self) -> bool:
        return self.to_us is not None and self.to_us - self.from_us < BRIEF_US
