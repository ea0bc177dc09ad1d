"""The goals of one action server: the present goal, and stale ones that it may still have.

This module is pure logic; `ros.py` calls rclpy. A server has one goal of this robot at a time, of
any local task: the next one waits, and a goal that is no longer needed is cancelled before another
starts. The robot chooses the IDs of its goals, so those of an earlier bridge can be cancelled as
well. The middleware may lose any answer, so unanswered requests are repeated.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

from .server import (
    ABSENT_S,
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
# The period for repeating a cancellation.
AGAIN_S = 1.0
# The result of a goal is requested after ASK_S without an answer, then at doubling intervals.
ASK_S, MAX_ASK_S = 5.0, 60.0
# A goal that the server neither accepts nor knows for this long is lost; accepting may take time.
ACCEPT_S = 30.0
# A server that continues a cancelled goal for this long is faulty.
OBEY_S = 10.0

ENDS = {SUCCEEDED: "succeeded", CANCELED: "cancelled", ABORTED: "aborted", UNKNOWN: "lost"}


@dataclass
class _Goal:
    run: int
    goal_id: bytes
    body: Any
    since_s: float
    is_accepted: bool = False
    # True if the goal may still reach a server that does not know it.
    is_under_way: bool = True
    # None: not sent yet.
    sent_s: float | None = None
    asked_s: float = 0.0
    pause_s: float = ASK_S

    @property
    def is_sent(self) -> bool:
        """True if the goal was sent, so the server may have it."""
        return self.sent_s is not None


@dataclass
class _Stale:
    """A goal that is no longer needed. `run` is None if it had been given up as lost."""

    run: int | None
    is_accepted: bool
    since_s: float
    # When its cancellation was last sent, and when its result was last requested.
    asked_s: float | None = None
    asked_result_s: float | None = None
    pause_s: float = AGAIN_S


class GoalKeeper(ServerKeeper):
    """Manages one server's goals. Methods return effects to carry out; `now_s` is monotonic."""

    def __init__(self, detection_s: float, now_s: float) -> None:
        super().__init__(detection_s, now_s)
        self._goal: _Goal | None = None
        self._waiting: deque[_Goal] = deque()
        self._stale: dict[bytes, _Stale] = {}

    # -- commands ------------------------------------------------------------------------------

    def start(self, run: int, goal_id: bytes, body: Any, now_s: float) -> list[ServerEffect]:
        """Queue a new goal; it waits until earlier goals have ended."""
        self._waiting.append(_Goal(run, goal_id, body, now_s))
        return self._advance(now_s)

    def cancel(self, run: int, now_s: float) -> list[ServerEffect]:
        """Cancel a run's goal. Its end is reported once the server has stopped."""
        for waiting in self._waiting:
            if waiting.run == run:
                self._waiting.remove(waiting)
                return [RunEnded(run, "cancelled", "", {})]
        goal = self._goal
        if goal is None or goal.run != run:
            return []
        self._goal = None
        if not goal.is_sent:
            return [RunEnded(run, "cancelled", "", {}), *self._advance(now_s)]
        self._stale[goal.goal_id] = _Stale(run, goal.is_accepted, now_s)
        return self._advance(now_s)

    def forget(self, run: int, goal_id: bytes, now_s: float) -> list[ServerEffect]:
        """Cancel a goal that an earlier bridge of this robot sent.

        The end of its run is reported once the server has stopped.
        """
        self._stale[goal_id] = _Stale(run, True, now_s)
        return self._advance(now_s)

    # -- answers -------------------------------------------------------------------------------

    def run_of(self, goal_id: bytes) -> int | None:
        """Return the run of a goal if it is the present goal, else None."""
        goal = self._goal
        return goal.run if goal is not None and goal.goal_id == goal_id else None

    def fed_back(self, goal_id: bytes, now_s: float) -> list[ServerEffect]:
        """Process feedback: the server works on the goal, so it has accepted it."""
        goal = self._goal
        if goal is not None and goal.goal_id == goal_id and not goal.is_accepted:
            return self.answered(goal_id, True, now_s)
        return self.heard(now_s)

    def servers(self, found: frozenset[bytes], now_s: float) -> list[ServerEffect]:
        """Process the list of servers of this name; a new one may not know the present goal."""
        known = self._servers.keys()
        is_another = bool(known and found - known)
        effects, goal = super().servers(found, now_s), self._goal
        if is_another and goal is not None and goal.is_sent:
            goal.is_under_way = False
            effects.append(AskResult(goal.goal_id))
        return effects

    def answered(self, goal_id: bytes, accepted: bool, now_s: float) -> list[ServerEffect]:
        """Process the server's answer whether it accepts a goal."""
        effects = self.heard(now_s)
        goal, stale = self._goal, self._stale.get(goal_id)
        if goal is not None and goal.goal_id == goal_id:
            if accepted:
                goal.is_accepted, goal.is_under_way = True, False
                goal.asked_s, goal.pause_s = now_s, ASK_S
                return [*effects, AskResult(goal_id)]
            self._goal = None
            effects += [RunEnded(goal.run, "rejected", "", {}), *self._advance(now_s)]
        elif accepted:
            # The goal is no longer needed, or was given up as lost.
            stale = self._stale.setdefault(goal_id, _Stale(None, True, now_s))
            stale.is_accepted = True
            return [*effects, AskResult(goal_id), *self._advance(now_s)]
        elif stale is not None:
            effects += self._dropped(goal_id, now_s)
        return effects

    def result(
        self, goal_id: bytes, status: int, text: str, fields: dict[str, Any], now_s: float
    ) -> list[ServerEffect]:
        """Process the result of a goal, or the answer that the server does not know it."""
        effects = self.heard(now_s)
        goal, stale = self._goal, self._stale.get(goal_id)
        if goal is not None and goal.goal_id == goal_id:
            if status == UNKNOWN and goal.is_under_way and not self._is_overdue(goal, now_s):
                return effects
            self._goal = None
            ended = RunEnded(goal.run, ENDS.get(status, "lost"), text, fields)
            effects += [ended, *self._advance(now_s)]
        elif stale is not None and (status != UNKNOWN or stale.is_accepted):
            # The goal may have succeeded before the cancellation reached the server.
            how = ENDS[SUCCEEDED if status == SUCCEEDED else CANCELED]
            effects += self._dropped(goal_id, now_s, how, text, fields)
        return effects

    def cancel_answered(self, goal_id: bytes, code: int, now_s: float) -> list[ServerEffect]:
        """Process the answer to a cancellation. Only the result shows that the goal has stopped.

        A goal that is being cancelled cannot be cancelled again: the answer then is TERMINATED as
        well.
        """
        effects = self.heard(now_s)
        stale = self._stale.get(goal_id)
        if stale is None:
            return effects
        if code == TERMINATED:
            stale.is_accepted = True
            asked_s = stale.asked_result_s
            if asked_s is None or now_s - asked_s >= stale.pause_s:
                if asked_s is not None:
                    stale.pause_s = min(2 * stale.pause_s, MAX_ASK_S)
                stale.asked_result_s = now_s
                effects.append(AskResult(goal_id))
        # The cancellation may have overtaken the goal, which has arrived after AGAIN_S.
        elif code == UNKNOWN_GOAL and (stale.is_accepted or now_s - stale.since_s >= 2 * AGAIN_S):
            effects += self._dropped(goal_id, now_s)
        return effects

    def refused(self, run: int, text: str, now_s: float) -> list[ServerEffect]:
        """End a run whose goal does not fit the server's type."""
        if self._goal is None or self._goal.run != run:
            return []
        self._goal = None
        return [RunEnded(run, "unfit", text, {}), *self._advance(now_s)]

    # -- what follows --------------------------------------------------------------------------

    @property
    def is_clear(self) -> bool:
        """True if the server cannot have any goal of this robot."""
        return self._goal is None and not self._waiting and not self._stale

    def _is_overdue(self, goal: _Goal, now_s: float) -> bool:
        return goal.sent_s is not None and now_s - goal.sent_s >= ACCEPT_S

    def _silence(self) -> str:
        is_at_work = self._goal is not None and self._goal.is_sent
        return "does not answer while it works: does it have one thread only?" if is_at_work else ""

    def _came_back(self, now_s: float) -> list[ServerEffect]:
        # It may be another process, which does not know the goal.
        goal = self._goal
        if goal is None or not goal.is_sent:
            return []
        goal.is_under_way = False
        goal.asked_s, goal.pause_s = now_s, ASK_S
        return [AskResult(goal.goal_id)]

    def _advance(self, now_s: float) -> list[ServerEffect]:
        effects: list[ServerEffect] = []
        if self._goal is None and self._waiting:
            self._goal = self._waiting.popleft()
        is_there, goal = self._watch.is_there, self._goal
        is_waiting = goal is not None and not goal.is_sent and not is_there
        if goal is not None and is_waiting and now_s - goal.since_s >= ABSENT_S:
            self._goal = None
            return [RunEnded(goal.run, "absent", self._why_not, {}), *self._advance(now_s)]
        is_one = (count := self._count(now_s)) <= 1
        if is_there:
            for goal_id, stale in self._stale.items():
                if stale.asked_s is None or now_s - stale.asked_s >= AGAIN_S:
                    stale.asked_s = now_s
                    effects.append(CancelGoal(goal_id))
            if goal is not None and goal.is_sent:
                effects += self._asked(goal, now_s)
            elif goal is not None and not self._stale and is_one:
                goal.sent_s = goal.asked_s = now_s
                effects.append(SendGoal(goal.run, goal.goal_id, goal.body))
        obeys = not any(now_s - stale.since_s >= OBEY_S for stale in self._stale.values())
        if is_there and not obeys:
            self._why_not = "does not stop its cancelled goal"
        elif is_there and not is_one:
            self._why_not = f"is {count} servers that would all take a goal: give them namespaces"
        # A server that returns can be used once it has no stale goals.
        is_free = self._last.is_up or not self._stale
        return effects + self._told(is_there and obeys and is_one and is_free)

    def _asked(self, goal: _Goal, now_s: float) -> list[ServerEffect]:
        """Request the result again if it is time, because an answer may have been lost."""
        if now_s - goal.asked_s < goal.pause_s:
            return []
        goal.asked_s, goal.pause_s = now_s, min(2 * goal.pause_s, MAX_ASK_S)
        return [AskResult(goal.goal_id)]

    def _dropped(
        self,
        goal_id: bytes,
        now_s: float,
        how: str = "cancelled",
        text: str = "",
        fields: dict[str, Any] | None = None,
    ) -> list[ServerEffect]:
        """Remove a stale goal that has ended, or that its server does not know."""
        stale = self._stale.pop(goal_id)
        ended: list[ServerEffect] = []
        if stale.run is not None:
            ended = [RunEnded(stale.run, how, text, fields or {})]
        return ended + self._advance(now_s)
