"""The goals of one action server: the present one, and those that may be left at it.

Values in, values out; rclpy is in `ros.py`. A server has one goal of this robot at a time, and a
goal that is no longer needed is cancelled before anything else begins. The robot names its goals,
so those of an earlier bridge can be cancelled as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .server import (
    AskResult,
    CancelGoal,
    RunEnded,
    SendGoal,
    ServerEffect,
    ServerKeeper,
)

# action_msgs/msg/GoalStatus
UNKNOWN, SUCCEEDED, CANCELED, ABORTED = 0, 4, 5, 6
# action_msgs/srv/CancelGoal
UNKNOWN_GOAL, TERMINATED = 2, 3
# The period of sending a cancellation again.
AGAIN_S = 1.0
# A server that goes on with a cancelled goal for this long is a fault.
OBEY_S = 10.0

ENDS = {SUCCEEDED: "succeeded", CANCELED: "cancelled", ABORTED: "aborted", UNKNOWN: "lost"}


@dataclass
class _Goal:
    run: int
    goal_id: bytes
    body: Any
    is_sent: bool = False
    is_accepted: bool = False


@dataclass
class _Stale:
    """A goal that is no longer needed; `run` is None for one of an earlier bridge."""

    run: int | None
    is_accepted: bool
    since_s: float
    asked_s: float | None = None


class GoalKeeper(ServerKeeper):
    """One server's goals. Every method returns what is to be done; `now_s` never goes back."""

    def __init__(self, detection_s: float, now_s: float) -> None:
        super().__init__(detection_s, now_s)
        self._goal: _Goal | None = None
        self._stale: dict[bytes, _Stale] = {}
        # The middleware's ids of the servers of this name: another id is another process.
        self._servers: frozenset[bytes] = frozenset()

    # -- commands ------------------------------------------------------------------------------

    def start(self, run: int, goal_id: bytes, body: Any, now_s: float) -> list[ServerEffect]:
        """A new goal; the one before has ended or was cancelled."""
        effects = self.cancel(self._goal.run, now_s) if self._goal is not None else []
        self._goal = _Goal(run, goal_id, body)
        return effects + self._advance(now_s)

    def cancel(self, run: int, now_s: float) -> list[ServerEffect]:
        """A run's goal is no longer needed; its end is reported once the server has stopped."""
        goal = self._goal
        if goal is None or goal.run != run:
            return []
        self._goal = None
        if not goal.is_sent:
            return [RunEnded(run, "cancelled", "", {})]
        self._stale[goal.goal_id] = _Stale(run, goal.is_accepted, now_s)
        return self._advance(now_s)

    def forget(self, goal_ids: list[bytes], now_s: float) -> list[ServerEffect]:
        """Goals of an earlier bridge of this robot are no longer needed."""
        for goal_id in goal_ids:
            self._stale.setdefault(goal_id, _Stale(None, True, now_s))
        return self._advance(now_s)

    # -- answers -------------------------------------------------------------------------------

    def run_of(self, goal_id: bytes) -> int | None:
        """The run whose goal this is, if it is the present one."""
        goal = self._goal
        return goal.run if goal is not None and goal.goal_id == goal_id else None

    def servers(self, found: frozenset[bytes]) -> list[ServerEffect]:
        """The servers of this name that the middleware knows."""
        known, self._servers = self._servers, found
        goal = self._goal
        if known and found - known and goal is not None and goal.is_sent:
            return [AskResult(goal.goal_id)]
        return []

    def answered(self, goal_id: bytes, accepted: bool, now_s: float) -> list[ServerEffect]:
        """Whether the server takes a goal."""
        effects = self.heard(now_s)
        goal, stale = self._goal, self._stale.get(goal_id)
        if goal is not None and goal.goal_id == goal_id:
            if accepted:
                goal.is_accepted = True
                return [*effects, AskResult(goal_id)]
            self._goal = None
            effects.append(RunEnded(goal.run, "rejected", "", {}))
        elif accepted:
            # One that is no longer needed, or seemed to be lost.
            stale = self._stale.setdefault(goal_id, _Stale(None, True, now_s))
            stale.is_accepted = True
            return [*effects, AskResult(goal_id), *self._advance(now_s)]
        elif stale is not None:
            effects += self._dropped(goal_id, now_s)
        return effects

    def result(
        self, goal_id: bytes, status: int, text: str, fields: dict[str, Any], now_s: float
    ) -> list[ServerEffect]:
        """How a goal has ended, or that the server does not know it."""
        effects = self.heard(now_s)
        goal, stale = self._goal, self._stale.get(goal_id)
        if goal is not None and goal.goal_id == goal_id:
            self._goal = None
            effects.append(RunEnded(goal.run, ENDS.get(status, "lost"), text, fields))
        elif stale is not None and (status != UNKNOWN or stale.is_accepted):
            effects += self._dropped(goal_id, now_s)
        return effects

    def cancel_answered(self, goal_id: bytes, code: int, now_s: float) -> list[ServerEffect]:
        """The answer to a cancellation; the result shows that the goal has stopped."""
        effects = self.heard(now_s)
        stale = self._stale.get(goal_id)
        if stale is None or code not in (UNKNOWN_GOAL, TERMINATED):
            return effects
        # The cancellation may have come before the goal, which is there after AGAIN_S.
        if stale.is_accepted or now_s - stale.since_s >= 2 * AGAIN_S:
            effects += self._dropped(goal_id, now_s)
        return effects

    def refused(self, run: int, text: str, now_s: float) -> list[ServerEffect]:
        """The goal does not fit the server's type."""
        if self._goal is None or self._goal.run != run:
            return []
        self._goal = None
        return [RunEnded(run, "unfit", text, {}), *self._advance(now_s)]

    # -- what follows --------------------------------------------------------------------------

    @property
    def is_clear(self) -> bool:
        """Whether nothing of ours is at the server, or may be."""
        return self._goal is None and not self._stale

    def _came_back(self) -> list[ServerEffect]:
        # Perhaps it is another process, which knows nothing of the goal.
        goal = self._goal
        return [AskResult(goal.goal_id)] if goal is not None and goal.is_sent else []

    def _advance(self, now_s: float) -> list[ServerEffect]:
        effects: list[ServerEffect] = []
        is_there, goal = self._watch.is_there, self._goal
        if is_there:
            for goal_id, stale in self._stale.items():
                if stale.asked_s is None or now_s - stale.asked_s >= AGAIN_S:
                    stale.asked_s = now_s
                    effects.append(CancelGoal(goal_id))
            if goal is not None and not goal.is_sent and not self._stale:
                goal.is_sent = True
                effects.append(SendGoal(goal.run, goal.goal_id, goal.body))
        obeys = not any(now_s - stale.since_s >= OBEY_S for stale in self._stale.values())
        if is_there and not obeys:
            self._why_not = "does not stop its cancelled goal"
        # A server that comes back can be used when nothing is left at it.
        return effects + self._told(is_there and obeys and (self._last.is_up or not self._stale))

    def _dropped(self, goal_id: bytes, now_s: float) -> list[ServerEffect]:
        stale = self._stale.pop(goal_id)
        ended: list[ServerEffect] = []
        if stale.run is not None:
            ended = [RunEnded(stale.run, "cancelled", "", {})]
        return ended + self._advance(now_s)
