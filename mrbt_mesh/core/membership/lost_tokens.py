"""Which lost liveliness tokens are signs of death, where robots are clients of routers.

A token is gone for everybody when its robot's process ends, and just so when the router dies that
the robot was linked to, or the way to that router. So the router is asked: a lost token says
something only if the router still answers, and has no link to the robot any more. Otherwise
heartbeats decide, as for a robot whose token is still there.
"""

from __future__ import annotations

from mrbt_mesh.core.facts.store import Incarnation


class LostTokens:
    """The lost tokens of one robot's peers about which a router has been asked."""

    def __init__(self) -> None:
        self._asked: dict[str, Incarnation] = {}

    def must_ask(self, robot: str, incarnation: Incarnation, is_held: bool, router: str) -> bool:
        """A token came (`is_held`) or went; whether the router must be asked what that means."""
        self._asked.pop(robot, None)
        if is_held or not router:
            return False
        self._asked[robot] = incarnation
        return True

    def heard(self, robot: str) -> None:
        """The robot itself has been heard: whatever the router answers is old by now."""
        self._asked.pop(robot, None)

    def is_loss(self, robot: str, incarnation: Incarnation, is_linked: bool | None) -> bool:
        """Whether the router's answer makes the lost token a sign of death.

        `is_linked`: whether a router has a link to the robot; None: the router does not answer.
        """
        if self._asked.get(robot) != incarnation:
            return False
        del self._asked[robot]
        return is_linked is False
