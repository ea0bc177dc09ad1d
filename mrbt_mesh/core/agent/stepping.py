"""Until when a robot's program may go on with its local task, by what the robot has heard.

After that the action is not cancelled, but waits for news before its next step. Only work that must
stop in time by this robot's own clock needs this, as features say. If that clock has stood still
(`peer_clocks`), news reveals it.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.parts import Parts


class Stepping:
    """The time limit of the action that runs now."""

    def __init__(self, context: Context, parts: Parts) -> None:
        self._context = context
        self._parts = parts

    def until_us(self) -> int | None:
        """Until when its steps need no further news; None if there is no limit.

        A cancelled action has no limit, as it ends what must not be left undone.
        """
        work = self._context.work
        if work.action is None or work.is_stopping or not work.action.global_task:
            return None
        times_us = [until_us() for until_us in self._parts.steps_until_us]
        return min((each_us for each_us in times_us if each_us is not None), default=None)
