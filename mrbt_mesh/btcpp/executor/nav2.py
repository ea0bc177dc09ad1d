"""Nav2's control nodes and decorators, as its documentation and behavior_trees files use them.

What Nav2 asks of ROS comes from sources that the program registers: `robot_pose` gives (x, y) in
metres, `robot_speed` metres a second, `goal_update` the latest goal or None. A child that has
completed begins anew when it is ticked again, as Nav2's own actions do.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar

from mrbt_mesh.btcpp.executor.decorators import Decorator
from mrbt_mesh.btcpp.executor.node import (
    FAILURE,
    IDLE,
    MICRO,
    RUNNING,
    SKIPPED,
    SUCCESS,
    NodeStatus,
    TickError,
    TreeNode,
    reset,
    reset_all,
)


def _afresh(child: TreeNode) -> NodeStatus:
    if child.status is not RUNNING:
        child.status = IDLE
    return child.execute()


class PipelineSequence(TreeNode):
    """A Sequence that ticks the children before the running one again, at every tick."""

    __slots__ = ("last",)
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def clear(self) -> None:
        self.last = 0

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        skipped = 0
        for index, child in enumerate(self.children):
            status = _afresh(child)
            if status is FAILURE:
                return self.ended(FAILURE)
            if status is RUNNING and index >= self.last:
                self.last = index
                return RUNNING
            skipped += status is SKIPPED
        return self.ended(SKIPPED if skipped == len(self.children) else SUCCESS)


class RecoveryNode(TreeNode):
    """The first child; when it fails the second one, and then the first one again."""

    __slots__ = ("index", "retries")
    CHILDREN: ClassVar[tuple[int, int | None]] = (2, 2)

    def clear(self) -> None:
        self.index = self.retries = 0

    def tick(self) -> NodeStatus:
        allowed = int(self.input("number_of_retries", "int"))
        self.status = RUNNING
        while self.retries <= allowed:
            status = _afresh(self.children[self.index])
            if status is RUNNING:
                return RUNNING
            if self.index == 0:
                if status is not FAILURE or self.retries >= allowed:
                    return self.ended(status)
                reset(self.children[0])
                self.index = 1
            elif status is SUCCESS:
                reset(self.children[1])
                self.retries += 1
                self.index = 0
            else:
                return self.ended(FAILURE)
        return self.ended(FAILURE)


class RoundRobin(TreeNode):
    """The next child at each turn, until one succeeds.

    After the last child it fails; with `wrap_around` the first one follows.
    """

    __slots__ = ("failed", "index", "skipped")
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def clear(self) -> None:
        self.index = self.failed = self.skipped = 0

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        count, wraps = len(self.children), self.input("wrap_around", "bool")
        while self.failed + self.skipped < count and self.index < count:
            status = _afresh(self.children[self.index])
            if status is RUNNING:
                return RUNNING
            self.index += 1
            if wraps and self.index == count:
                self.index = 0
            if status is SUCCESS:
                self.failed = self.skipped = 0
                reset_all(self.children)
                return SUCCESS
            self.failed += status is FAILURE
            self.skipped += status is SKIPPED
        return self.ended(SKIPPED if self.skipped == count else FAILURE)


class _Gate(Decorator):
    """Ticks the child the first time, while it runs, and whenever `is_open`."""

    __slots__ = ("first",)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.first = True

    @abstractmethod
    def begin(self) -> None:
        """Called when a new round of this node begins."""

    @abstractmethod
    def is_open(self) -> bool:
        """Whether the child is due again."""

    def succeeded(self) -> None:
        """The child has succeeded."""

    def tick(self) -> NodeStatus:
        if self.status is not RUNNING:
            self.first = True
            self.begin()
        self.status = RUNNING
        is_open = self.is_open()
        if not (self.first or self.child.status is RUNNING or is_open):
            return RUNNING
        self.first = False
        status = _afresh(self.child)
        if status is SUCCESS:
            self.succeeded()
        return status


class RateController(_Gate):
    """The child at most `hz` times a second."""

    __slots__ = ("period_us", "since_us")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.period_us = self.since_us = 0

    def _wait(self) -> None:
        self.since_us = self.world.now_us
        self.world.deadlines_us[self.uid] = self.since_us + self.period_us

    def begin(self) -> None:
        rate = float(self.input("hz", "double"))
        if not rate > 0:
            raise TickError(f"{self.place}: hz={rate:g} is not positive")
        self.period_us = round(MICRO / rate)
        self._wait()

    def is_open(self) -> bool:
        return self.world.now_us - self.since_us >= self.period_us

    def succeeded(self) -> None:
        self._wait()

    def clear(self) -> None:
        self.world.deadlines_us.pop(self.uid, None)


class SpeedController(_Gate):
    """The child at a rate between `min_rate` and `max_rate`, faster the faster the robot is."""

    SOURCES = ("robot_speed",)
    __slots__ = ("period_us", "since_us")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.period_us = self.since_us = 0

    def _rate(self, share: float) -> float:
        slow, fast = (float(self.input(port, "double")) for port in ("min_rate", "max_rate"))
        if not 0 < slow <= fast:
            raise TickError(f"{self.place}: min_rate and max_rate have to be positive, in order")
        return slow + min(max(share, 0.0), 1.0) * (fast - slow)

    def begin(self) -> None:
        self.period_us = round(MICRO / self._rate(1.0))
        self.since_us = self.world.now_us

    def is_open(self) -> bool:
        if self.world.now_us - self.since_us < self.period_us:
            return False
        low, high = (float(self.input(port, "double")) for port in ("min_speed", "max_speed"))
        if not low < high:
            raise TickError(f"{self.place}: min_speed has to be below max_speed")
        share = (float(self.world.sources["robot_speed"]()) - low) / (high - low)
        self.period_us = round(MICRO / self._rate(share))
        self.since_us = self.world.now_us
        return True


class DistanceController(_Gate):
    """The child each time the robot has travelled `distance` metres, in a straight line."""

    SOURCES = ("robot_pose",)
    __slots__ = ("start",)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.start = (0.0, 0.0)

    def _pose(self) -> tuple[float, float]:
        x, y, *_ = self.world.sources["robot_pose"]()
        return float(x), float(y)

    def begin(self) -> None:
        self.start = self._pose()

    def is_open(self) -> bool:
        return math.dist(self.start, self._pose()) >= float(self.input("distance", "double"))

    def succeeded(self) -> None:
        self.start = self._pose()


class GoalUpdater(Decorator):
    """Writes the latest goal, else `input_goal`, to `output_goal`, and ticks the child."""

    __slots__ = ()

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        source = self.world.sources.get("goal_update")
        latest = source() if source is not None else None
        self.output("output_goal", self.input("input_goal", "") if latest is None else latest)
        return _afresh(self.child)


NAV2: dict[str, type[TreeNode]] = {
    "PipelineSequence": PipelineSequence,
    "RecoveryNode": RecoveryNode,
    "RoundRobin": RoundRobin,
    "RateController": RateController,
    "DistanceController": DistanceController,
    "SpeedController": SpeedController,
    "GoalUpdater": GoalUpdater,
}
# Ports and their defaults, as Nav2 registers them.
NAV2_DEFAULTS: dict[str, dict[str, str]] = {
    "RecoveryNode": {"number_of_retries": "999"},
    "RoundRobin": {"wrap_around": "false"},
    "RateController": {"hz": "10.0"},
    "DistanceController": {"distance": "1.0"},
    "SpeedController": {
        "min_rate": "0.1",
        "max_rate": "1.0",
        "min_speed": "0.0",
        "max_speed": "0.5",
    },
}
