"""Commands of operators as steps of a simulation's schedule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mrbt_mesh.features.contact.loans import BORROWED, Loan
from mrbt_mesh.sim.world.team_commands import OfRobot


@dataclass(frozen=True, slots=True)
class Borrow(OfRobot):
    """Take a robot out of the team's work at once, or `after_task`: after its current task."""

    after_task: bool = False

    def content(self) -> tuple[str, Any]:
        """See `OfRobot`."""
        return BORROWED, str(Loan.AFTER_TASK if self.after_task else Loan.AT_ONCE)


@dataclass(frozen=True, slots=True)
class Return(OfRobot):
    """Give a borrowed robot back to the team."""

    def content(self) -> tuple[str, Any]:
        """See `OfRobot`."""
        return BORROWED, str(Loan.RETURNED)
