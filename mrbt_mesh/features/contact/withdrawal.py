"""Withdraw this robot from the team's work and give it back, for reasons other than a fault.

The robot stays a member. While it is withdrawn it has no capabilities; its member fact shows this
to all robots, with the reason.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.feature import Kit
from mrbt_mesh.core.mission.names import ALL


class Withdrawal:
    """Withdraws this robot and gives it back.

    `waiting` maps a source to the reason why the robot will be withdrawn after its task, and to the
    task's activation.
    """

    def __init__(self, kit: Kit) -> None:
        self._context = kit.context
        self._health = kit.health
        self.waiting: dict[str, tuple[str, str]] = {}

    def withdraw(self, source: str, reason: str, now_us: int, *, after_task: bool = False) -> None:
        """Withdraw the robot at once, cancelling its task, or after the task that it works on."""
        work = self._context.work
        if after_task and work.action is not None and not work.is_stopping:
            self.waiting[source] = reason, work.action.activation
        else:
            self._health.change_capability(
                CapabilityChanged(ALL, True, reason, source, is_pending=True), now_us
            )

    def give_back(self, source: str, now_us: int) -> None:
        """Let the robot work again, unless another source withdraws it."""
        self.waiting.pop(source, None)
        self._health.change_capability(CapabilityChanged(ALL, False, source=source), now_us)

    def follow(self, now_us: int) -> None:
        """Withdraw the robot if the task that it was to finish first has ended."""
        work, waiting = self._context.work, self.waiting
        for source, (reason, activation) in list(waiting.items()):
            goes_on = work.claim is not None and work.claim.activation == activation
            if not goes_on and work.action is None:
                del waiting[source]
                self.withdraw(source, reason, now_us)
