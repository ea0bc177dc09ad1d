"""What an operator's client commands a whole team, as a step of a schedule beside its faults."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.mission.job_arguments import Arguments
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.sim.world.faults import Fault


@dataclass(frozen=True, slots=True)
class TeamCommand(Fault):
    """A command that goes to all robots that live then."""


@dataclass(frozen=True, slots=True)
class Submit(TeamCommand):
    """Hand in a job of a type. `arguments`: texts and whole numbers, in order or by the parameters'
    names. `id`: empty: `job-1`, `job-2`, ... in the order in which such jobs are listed.
    `priority`: None: the type's. `not_before_s`, `deadline_s`: seconds from the submission; None:
    at once, and as the type says.
    """

    type: str
    arguments: Arguments = ()
    id: str = ""
    priority: int | None = None
    not_before_s: float | None = None
    deadline_s: float | None = None


@dataclass(frozen=True, slots=True)
class CancelJob(TeamCommand):
    """Stop a job for good."""

    id: str


@dataclass(frozen=True, slots=True)
class HoldJob(TeamCommand):
    """Begin no further step of a job; `now`: cancel what runs of it, too."""

    id: str
    now: bool = False


@dataclass(frozen=True, slots=True)
class ReleaseJob(TeamCommand):
    """Go on with a job that was held."""

    id: str


@dataclass(frozen=True, slots=True)
class SetPriority(TeamCommand):
    """Give a job another priority."""

    id: str
    priority: int


@dataclass(frozen=True, slots=True)
class Propose(TeamCommand):
    """Propose a mission as the next revision; it is withdrawn if it is not in force in time."""

    mission: Mission = field(repr=False)
    is_forced: bool = False
    repeats_exclusive: bool = False


@dataclass(frozen=True, slots=True)
class OfRobot(TeamCommand, ABC):
    """A command of a feature about a robot."""

    robot: str

    @abstractmethod
    def content(self) -> tuple[str, Any]:
        """The field that is commanded, and its value as plain data."""


@dataclass(frozen=True, slots=True)
class PauseTeam(TeamCommand):
    """Stop all work."""


@dataclass(frozen=True, slots=True)
class ResumeTeam(TeamCommand):
    """Go on with the work after a pause."""


@dataclass(frozen=True, slots=True)
class AbortMission(TeamCommand):
    """End the mission as failed."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """A step of a schedule that came to nothing, when it was due, and why."""

    at_us: int
    step: Fault
    reason: str
