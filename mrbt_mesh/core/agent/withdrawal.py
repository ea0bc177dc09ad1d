"""Taking this robot out of the team's work and back, for reasons that are no fault of its own.

It stays a member. While it is out it has none of its capabilities, which all robots see in its
member fact with the reason.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.facts.records import Loan
from mrbt_mesh.core.mission.names import ALL

BORROWED = "borrowed"


class Withdrawal:
    """`waiting`: why the robot will be out once its task has ended, and the task's activation, by
    source.
    """

    def __init__(self, context: Context, health: Health) -> None:
        self._context = context
        self._health = health
        self.waiting: dict[str, tuple[str, str]] = {}
        self._loan: tuple[str, Loan] | None = None

    def withdraw(self, source: str, reason: str, now_us: int, *, after_task: bool = False) -> None:
        """Take the robot out, at once or after its task; its task is cancelled or goes on."""
        work = self._context.work
        if after_task and work.action is not None and not work.is_stopping:
            self.waiting[source] = reason, work.action.activation
        else:
            self._health.change_capability(
                CapabilityChanged(ALL, True, reason, source, is_pending=True), now_us
            )

    def give_back(self, source: str, now_us: int) -> None:
        """The robot may work again, as far as this source is concerned."""
        self.waiting.pop(source, None)
        self._health.change_capability(CapabilityChanged(ALL, False, source=source), now_us)

    def follow(self, now_us: int) -> None:
        """Follow what operators have commanded, and take the robot out if the task has ended that
        was waited for.
        """
        self._follow_loan(now_us)
        work, waiting = self._context.work, self.waiting
        for source, (reason, activation) in list(waiting.items()):
            goes_on = work.claim is not None and work.claim.activation == activation
            if not goes_on and work.action is None:
                del waiting[source]
                self.withdraw(source, reason, now_us)

    # -- borrowing ----------------------------------------------------------------------------

    def _follow_loan(self, now_us: int) -> None:
        """Do what operators have commanded: this robot is lent to one of them, or returned."""
        loan = self._context.facts.borrowers.get(self._context.me)
        if loan == self._loan:
            return
        self._loan = loan
        if loan is None:
            self._context.log("info", "returned")
            self.give_back(BORROWED, now_us)
        else:
            by, since = loan
            self._context.log("warning", "borrowed", by=by)
            is_after = since is Loan.AFTER_TASK
            self.withdraw(BORROWED, f"borrowed by {by}", now_us, after_task=is_after)
