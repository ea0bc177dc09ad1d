"""Nav2's control nodes and decorators, as its documentation and behavior_trees files use them.

The data that Nav2 gets from ROS comes from sources that the program registers: `robot_pose` returns
(x, y) in metres, `robot_speed` metres per second, `goal_update` the latest goal or None, and
`paused` whether the robot should pause. Source: the C++ of Nav2 1.5 (commit a3a97043). A control
does not reset a completed child until the control itself ends, so an action below it is not started
again, and a decorator that has succeeded continues where it was. Ports and their defaults are in
`builtin_nodes.NAV2_NODES`.
"""

from __future__ import annotations

import enum
import math
from abc import abstractmethod
from typing import Any, ClassVar

from mrbt_mesh.btcpp.executor.decorators import Decorator
from mrbt_mesh.btcpp.executor.node import (
    COMPLETED,
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
from mrbt_mesh.btcpp.files.document import pointer
from mrbt_mesh.btcpp.scripts.values import read_text


class PipelineSequence(TreeNode):
    """A Sequence that, at every tick, also ticks the children before the running one again."""

    __slots__ = ("last",)
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def clear(self) -> None:
        self.last = 0

    def tick(self) -> NodeStatus:
        skipped = 0
        for index, child in enumerate(self.children):
            status = child.execute()
            if status is FAILURE:
                return self.ended(FAILURE)
            if status is RUNNING and index >= self.last:
                self.last = index
                return RUNNING
            skipped += status is SKIPPED
        return self.ended(SKIPPED if skipped == len(self.children) else SUCCESS)


class NonblockingSequence(TreeNode):
    """Ticks all children in order at every tick; fails as soon as one fails."""

    __slots__ = ()
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def tick(self) -> NodeStatus:
        found = []
        for child in self.children:
            status = child.execute()
            if status is FAILURE:
                return self.ended(FAILURE)
            found.append(status)
        if RUNNING in found:
            return RUNNING
        return self.ended(SUCCESS if SUCCESS in found else SKIPPED)


class PersistentSequence(TreeNode):
    """A Sequence that keeps its position in the port `current_child_idx`, even when halted."""

    __slots__ = ()
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def tick(self) -> NodeStatus:
        index = int(self.input("current_child_idx", "int"))
        if index < 0:
            raise TickError(f"{self.place}: current_child_idx={index} is not a child")
        self.status = RUNNING
        while index < len(self.children):
            status = self.children[index].execute()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                break
            index += 1
            self.output("current_child_idx", index)
        self.output("current_child_idx", 0)
        return self.ended(FAILURE if index < len(self.children) else SUCCESS)


class _Phase(enum.IntEnum):
    """Phase of a PauseResumeController; its value is the index of the child to tick."""

    RESUMED, PAUSED, ON_PAUSE, ON_RESUME = range(4)


class PauseResumeController(TreeNode):
    """Ticks the first child, or the second one while the source `paused` is true.

    The third child is run to completion before a pause, the fourth after it. The source replaces
    Nav2's services; without it the robot never pauses.
    """

    __slots__ = ("phase",)
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, 4)

    def clear(self) -> None:
        self.phase = _Phase.RESUMED

    def _turn(self) -> None:
        source = self.world.sources.get("paused")
        is_paused = bool(source()) if source is not None else False
        turned = {
            (_Phase.RESUMED, True): _Phase.ON_PAUSE,
            (_Phase.ON_RESUME, True): _Phase.ON_PAUSE,
            (_Phase.PAUSED, False): _Phase.ON_RESUME,
        }
        if (self.phase, is_paused) in turned:
            reset_all(self.children)
            self.phase = turned[self.phase, is_paused]

    def _next(self) -> None:
        following = {_Phase.ON_PAUSE: _Phase.PAUSED, _Phase.ON_RESUME: _Phase.RESUMED}
        self.phase = following.get(self.phase, self.phase)

    def tick(self) -> NodeStatus:
        if self.status is IDLE:
            self.clear()
            if not self.world.exact:
                # Children keep their status when this node ends: an action would not start again.
                reset_all(self.children)
        self.status = RUNNING
        self._turn()
        if self.phase >= len(self.children):
            self._next()
            return RUNNING
        status = self.children[self.phase].execute()
        if status is RUNNING or status is FAILURE:
            return status
        if self.phase is _Phase.RESUMED:
            return SUCCESS
        self._next()
        return RUNNING


class RecoveryNode(TreeNode):
    """Ticks the first child; if it fails, runs the second one and then retries the first."""

    __slots__ = ("index", "retries")
    CHILDREN: ClassVar[tuple[int, int | None]] = (2, 2)

    def clear(self) -> None:
        self.index = self.retries = 0

    def tick(self) -> NodeStatus:
        allowed = int(self.input("number_of_retries", "int"))
        self.status = RUNNING
        while self.retries <= allowed:
            status = self.children[self.index].execute()
            if status is RUNNING:
                return RUNNING
            if self.index == 0:
                if status is not FAILURE or self.retries >= allowed:
                    self.halt()
                    return status
                reset(self.children[0])
                self.index = 1
            elif status is FAILURE:
                break
            else:
                reset(self.children[1])
                self.index = 0
                if status is SKIPPED:
                    return FAILURE
                self.retries += 1
        self.halt()
        return FAILURE


class RoundRobin(TreeNode):
    """Ticks the children in turn until one succeeds; the next run continues with the next child.

    With `wrap_around` the first child follows the last. Without it, the node fails when the last
    child has ended, even if that child succeeded.
    """

    __slots__ = ("failed", "index")
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def clear(self) -> None:
        self.index = self.failed = 0

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        count, wraps = len(self.children), self.input("wrap_around", "bool")
        skipped = 0
        while self.failed + skipped < count:
            status = self.children[self.index].execute()
            if status is RUNNING:
                return RUNNING
            self.index += 1
            self.failed += status is FAILURE
            skipped += status is SKIPPED
            if self.index == count:
                if not wraps:
                    break
                self.index = 0
            if status is SUCCESS:
                self.failed = 0
                reset_all(self.children)
                return SUCCESS
        self.halt()
        return SKIPPED if skipped == count else FAILURE


class _Gate(Decorator):
    """Ticks the child the first time, while it runs, and whenever `is_open` is true.

    A round ends when this node is reset, not when the child ends: below a control that ticks its
    children again after they have succeeded, the child has to wait.
    """

    __slots__ = ("first", "has_begun")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.first = self.has_begun = False

    @abstractmethod
    def begin(self) -> None:
        """Called when a new round of this node begins."""

    @abstractmethod
    def is_open(self) -> bool:
        """Return whether the child is due again."""

    def succeeded(self) -> None:
        """Called when the child has succeeded."""

    def tick(self) -> NodeStatus:
        # A pre-condition may have ended this node before its first round.
        if self.status is IDLE or not self.has_begun:
            self.first = self.has_begun = True
            self.begin()
        self.status = RUNNING
        is_open = self.is_open()
        if not (self.first or self.child.status is RUNNING or is_open):
            return RUNNING
        self.first = False
        status = self.tick_child()
        if status is SUCCESS:
            self.succeeded()
        return status


class RateController(_Gate):
    """Ticks the child at most `hz` times a second."""

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
    """Ticks the child at a rate from `min_rate` to `max_rate` that grows with the robot's speed.

    A new `goal` or `goals` restarts it.
    """

    SOURCES = ("robot_speed",)
    __slots__ = ("goals", "period_us", "since_us")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.period_us = self.since_us = 0
        self.goals: tuple[Any, ...] = ()

    def _rate(self, share: float) -> float:
        slow, fast = (float(self.input(port, "double")) for port in ("min_rate", "max_rate"))
        if not 0 < slow <= fast:
            raise TickError(f"{self.place}: min_rate and max_rate have to be positive, in order")
        return slow + min(max(share, 0.0), 1.0) * (fast - slow)

    def begin(self) -> None:
        self.period_us = round(MICRO / self._rate(1.0))
        self.since_us = self.world.now_us
        self.goals = _goals(self)

    def is_open(self) -> bool:
        if self.goals != _goals(self):
            self.begin()
            return True
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
    """Ticks the child each time the robot is `distance` metres, in a straight line, further on."""

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
    """Writes the latest goal, else the input, to `output_goal` or `output_goals`; ticks the child.

    The source `goal_update` returns whichever of the two the tree uses.
    """

    __slots__ = ()

    def tick(self) -> NodeStatus:
        source = self.world.sources.get("goal_update")
        latest = source() if source is not None else None
        for read, written in (("input_goal", "output_goal"), ("input_goals", "output_goals")):
            if written in self.ports:
                self.output(written, self.input(read, "") if latest is None else latest)
        return self.tick_child()


class SingleTrigger(Decorator):
    """Runs the child to completion once per run of the parent; then returns FAILURE."""

    __slots__ = ("is_done",)

    def clear(self) -> None:
        self.is_done = False

    def tick(self) -> NodeStatus:
        if self.status is IDLE:
            self.clear()
        self.status = RUNNING
        if self.is_done:
            return FAILURE
        status = self.tick_child()
        self.is_done = status in COMPLETED
        return status


class GoalUpdatedController(Decorator):
    """Ticks the child the first time, while it runs, and whenever `goal` or `goals` has changed.

    Without these ports, the entries of the same names are used.
    """

    __slots__ = ("seen",)

    def clear(self) -> None:
        self.seen: tuple[Any, ...] | None = None

    def tick(self) -> NodeStatus:
        if self.status is IDLE:
            self.clear()
        self.status = RUNNING
        goals = _goals(self)
        if goals == self.seen and self.child.status is not RUNNING:
            return RUNNING
        self.seen = goals
        return self.tick_child()


def _goals(node: TreeNode) -> tuple[Any, ...]:
    return tuple(_read_or_entry(node, name) for name in ("goal", "goals"))


def _read_or_entry(node: TreeNode, name: str) -> Any:
    """Return the value of a port, or of the entry of that name; None if there is none."""
    text = node.ports.get(name, f"{{{name}}}")
    key = pointer(text, name)
    return text if key is None else node.board.read(key)


class PathLongerOnApproach(Decorator):
    """Ticks the child if, near the goal, a new path to it is much longer than the previous one.

    A path is a list of points (x, y) in metres, or a message like ROS's nav_msgs/Path.
    """

    __slots__ = ("before",)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.before: Any = None

    def tick(self) -> NodeStatus:
        path = _read_or_entry(self, "path")
        if path is None:
            path = self.before
        self.status = RUNNING
        if self._is_longer(path):
            status = self.tick_child()
            if status not in COMPLETED:
                return status
        else:
            status = SUCCESS
        self.before = path
        return status

    def _is_longer(self, path: Any) -> bool:
        if self.before is None or path == self.before:
            return False
        before, points = self._points(self.before), self._points(path)
        if not before or len(points) in (0, len(before)) or before[-1] != points[-1]:
            return False
        near, factor = (float(self.input(p, "double")) for p in ("prox_len", "length_factor"))
        length = _length(before)
        return length < near and _length(points) > factor * length

    def _points(self, path: Any) -> list[tuple[float, float]]:
        try:
            if hasattr(path, "poses"):
                positions = [each.pose.position for each in path.poses]
                return [(float(each.x), float(each.y)) for each in positions]
            found = read_text(path, "") if isinstance(path, str) else path
            return [(float(x), float(y)) for x, y, *_ in found]
        except (TypeError, ValueError, AttributeError):
            message = "a list of points (x, y) in metres is expected"
            raise TickError(f"{self.place}: port 'path': {message}") from None


def _length(points: list[tuple[float, float]]) -> float:
    return sum(map(math.dist, points, points[1:]))


NAV2: dict[str, type[TreeNode]] = {
    "PipelineSequence": PipelineSequence,
    "RecoveryNode": RecoveryNode,
    "RoundRobin": RoundRobin,
    "RateController": RateController,
    "DistanceController": DistanceController,
    "SpeedController": SpeedController,
    "GoalUpdater": GoalUpdater,
    "NonblockingSequence": NonblockingSequence,
    "PersistentSequence": PersistentSequence,
    "PauseResumeController": PauseResumeController,
    "SingleTrigger": SingleTrigger,
    "GoalUpdatedController": GoalUpdatedController,
    "PathLongerOnApproach": PathLongerOnApproach,
}
