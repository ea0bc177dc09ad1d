"""The robots that operators have borrowed, according to the facts."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mrbt_mesh.core.feature import Index

if TYPE_CHECKING:
    from mrbt_mesh.core.facts.store import Entry

# The field of the operators' commands; there is one per robot.
BORROWED = "borrowed"


class Loan(enum.StrEnum):
    """Whether an operator has borrowed a robot, and from when."""

    RETURNED = "returned"
    AT_ONCE = "at_once"
    AFTER_TASK = "after_task"


class Loans(Index):
    """`by_robot` maps a robot to the operator who borrowed it, and from when."""

    def __init__(self) -> None:
        self.by_robot: dict[str, tuple[str, Loan]] = {}

    def add(self, entry: Entry) -> None:
        from mrbt_mesh.core.facts.records import OperatorCommand

        command, robot = entry.record, entry.parts[1]
        assert isinstance(command, OperatorCommand)
        loan = Loan(command.value)
        self.by_robot.pop(robot, None)
        if loan is not Loan.RETURNED:
            self.by_robot[robot] = command.operator, loan

    def idle(self, reasons: Mapping[str, str]) -> Mapping[str, str]:
        borrowed = self.by_robot.items()
        return {robot: f"borrowed by {by}" for robot, (by, _) in borrowed if robot in reasons}
