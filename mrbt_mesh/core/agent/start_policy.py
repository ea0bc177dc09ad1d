"""What a robot waits for before it begins a task, besides the agreement of the team."""

from __future__ import annotations

from typing import NamedTuple

from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.planning.plan import Plan, RobotAssignment


class Situation(NamedTuple):
    """The input of a start policy. `is_grace_over`: the robot no longer waits for other robots."""

    plan: Plan
    assignment: RobotAssignment
    claim: Claim
    is_grace_over: bool
    now_us: int


class Clearance(NamedTuple):
    """Permission to start: with this party, if any, after writing these facts."""

    party: str = ""
    facts: tuple[Fact, ...] = ()


class StartPolicy:
    """What a robot waits for. As it is here: each starts as soon as the team agrees."""

    @property
    def needs_ready(self) -> bool:
        """Whether a robot first writes that it is ready."""
        return False

    def note_ready(self, number: int) -> None:
        """Note that the robot has promised, under this number, that it is ready."""

    def clear(self, situation: Situation) -> Clearance | None:
        """The clearance to start now; None if the robot has to wait."""
        return Clearance()

    def given_up(self, claim: Claim) -> list[Fact]:
        """The facts to write when a claim is dropped without an outcome."""
        return []


PLAIN_START = StartPolicy()
