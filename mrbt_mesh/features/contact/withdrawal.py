"""Taking this robot out of the team's work and back, for reasons that are no fault of its own.

It stays a member. While it is out it has none of its capabilities, which all robots see in its
member fact with the reason.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.feature import Kit
from mrbt_mesh.core.mission.names import ALL


class Withdrawal:
    """`waiting`: why the robot will be out once its task has ended, and the task's activation, by
    source.
    """

    def __init__(self, kit: Kit) -> None:
        self._context = kit.context
        self._health = kit.health
        self.waiting: dict[str, tuple[str, str]] = {}

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
        """Take the robot out if the task has ended that was waited for."""
        work, waiting = self._context.work, self.waiting
        for source, (reason, activation) in list(waiting.items()):
            goes_on = work.claim is not None and work.claim.activation == activation
            if not goes_on and work.action is None:
                del waiting[source]
                self.withdraw(source, reason, now_us)
