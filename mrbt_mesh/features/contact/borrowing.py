"""A robot that operators may borrow: carry out their commands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.agent.operator_desk import FieldRule, RefusalError
from mrbt_mesh.core.agent.operator_messages import CONFLICT, UNKNOWN
from mrbt_mesh.core.facts.records import OperatorCommand
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.feature import Kit, Part
from mrbt_mesh.features.contact.loans import BORROWED, Loan, Loans
from mrbt_mesh.features.contact.withdrawal import Withdrawal

_NONE = "", Loan.RETURNED


class Borrowing(Part):
    """Lends this robot to an operator, and takes it back."""

    def __init__(self, kit: Kit) -> None:
        self._context = kit.context
        self.withdrawal = Withdrawal(kit)
        self._loan: tuple[str, Loan] | None = None

    def rules(self) -> Mapping[str, FieldRule]:
        return {BORROWED: FieldRule(self._state, self._check)}

    def _loan_of(self, robot: str) -> tuple[str, Loan]:
        return self._context.facts.index(Loans).by_robot.get(robot, _NONE)

    def _state(self, robot: str) -> dict[str, Any]:
        by, since = self._loan_of(robot)
        return {"loan": str(since), "by": by}

    def _check(self, entry: Entry, _: int) -> None:
        command, robot, context = entry.record, entry.parts[1], self._context
        assert isinstance(command, OperatorCommand)
        by, _since = self._loan_of(robot)
        if robot not in context.facts.members and robot not in context.mission.robots:
            raise RefusalError(f"the team has no robot {robot}", UNKNOWN)
        if command.value is Loan.RETURNED and not by:
            raise RefusalError(f"{robot} is not borrowed", CONFLICT)
        if command.value is not Loan.RETURNED and by not in ("", command.operator):
            raise RefusalError(f"{robot} is borrowed by {by}: `mrbt return` it first", CONFLICT)

    def follow(self, now_us: int) -> None:
        loan = self._context.facts.index(Loans).by_robot.get(self._context.me)
        if loan != self._loan:
            self._loan = loan
            if loan is None:
                self._context.log("info", "returned")
                self.withdrawal.give_back(BORROWED, now_us)
            else:
                by, since = loan
                self._context.log("warning", "borrowed", by=by)
                is_after = since is Loan.AFTER_TASK
                reason = f"borrowed by {by}"
                self.withdrawal.withdraw(BORROWED, reason, now_us, after_task=is_after)
        self.withdrawal.follow(now_us)
