"""Passes the robot's commands to the keepers of its servers, and their reports to the robot.

The robot sends several messages within the detection time. If none arrives, the robot has stopped
or is disconnected; its team then assigns its work to other robots, so its goals are cancelled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from .calls import CallKeeper
from .goals import GoalKeeper
from .server import NOT_FOUND, RunEnded, RunWaits, ServerEffect, ServerTold, ServerWatch
from .values import UnfitError
from .watch import LifeWatch

# The time allowed for goals to stop after their robot has ended.
STOP_S = 3.0

LIFECYCLE = "lifecycle"
_KEEPERS: dict[str, type[ServerWatch]] = {
    "action": GoalKeeper,
    "srv": CallKeeper,
    "msg": CallKeeper,
    LIFECYCLE: ServerWatch,
}

Tell = Callable[[dict[str, Any]], None]
Step = Callable[[Any, float], "list[ServerEffect]"]


class RosEnd(Protocol):
    """The client's end of one server."""

    def carry_out(self, effect: ServerEffect) -> None: ...


class Ros(Protocol):
    """The interface to ROS that the bridge needs."""

    def serve(
        self,
        task: dict[str, Any],
        apply: Callable[[Step], None],
        feedback: Callable[[bytes, dict[str, Any]], None],
    ) -> RosEnd: ...
    def listen(self, topic: dict[str, Any], told: Callable[[dict[str, Any]], None]) -> None: ...


class Bridge:
    """Serves the bindings of one robot. `clock` returns monotonic seconds."""

    def __init__(self, bind: dict[str, Any], tell: Tell, clock: Callable[[], float]) -> None:
        self._bind, self._tell, self._clock = bind, tell, clock
        self._robot = LifeWatch(bind["detection_s"], clock())
        self._robot.heard(clock())
        # Keepers by server; tasks of the same action share one.
        self._keepers: dict[str, ServerWatch] = {}
        # The last state of each server, and the state of each task last sent to the robot.
        self._states: dict[str, ServerTold] = {}
        self._task_states: dict[str, ServerTold] = {}
        # The lifecycle nodes that must be active, by task.
        self._nodes: dict[str, str] = {}
        self._ends: dict[str, RosEnd] = {}
        self._tasks: dict[str, list[str]] = {}
        self._server_of: dict[str, str] = {}
        self._runs: dict[int, str] = {}
        self._silenced: set[int] = set()
        self._news: dict[tuple[str, Any], dict[str, Any]] = {}
        self._heard: dict[str, dict[str, Any]] = {}
        self._ended_s: float | None = None

    def connect(self, ros: Ros) -> None:
        """Create the clients. Raises rclpy's error for a name that ROS refuses."""
        self._nodes = {t["id"]: t["lifecycle"] for t in self._bind["tasks"] if t["lifecycle"]}
        for name, task in _servers(self._bind["tasks"]).items():
            self._tasks[name] = task["ids"]
            if task["kind"] != LIFECYCLE:
                self._server_of |= dict.fromkeys(task["ids"], name)
            self._keepers[name] = _KEEPERS[task["kind"]](self._bind["detection_s"], self._clock())
            self._ends[name] = ros.serve(task, self._applier(name), self._feedback(name))
        for topic in self._bind["topics"]:
            ros.listen(topic, self._listener(topic["id"], topic["always"]))

    # -- the robot -----------------------------------------------------------------------------

    def command(self, message: dict[str, Any]) -> None:
        """Carry out a command of the robot."""
        now_s = self._clock()
        self._robot.heard(now_s)
        op = message["op"]
        if op == "start":
            name, run = self._server_of[message["task"]], message["run"]
            self._runs[run] = name
            goal_id, body = message["goal_id"], message["body"]
            self._apply(name, lambda keeper, now_s: keeper.start(run, goal_id, body, now_s))
        elif op == "cancel" and message["run"] in self._runs:
            self._apply(self._runs[message["run"]], _cancelling(message["run"]))
        elif op == "forget":
            name, run = self._server_of[message["task"]], message["run"]
            goal_id = message["goal_id"]
            self._apply(name, lambda keeper, now_s: keeper.forget(run, goal_id, now_s))
        elif op == "beat":
            self._tell({"op": "beat"})

    def robot_gone(self) -> None:
        """Cancel all runs, because the pipe to the robot has ended."""
        self._ended_s = self._clock()
        self._cancel_all()

    @property
    def is_over(self) -> bool:
        """True if the robot has ended and its runs have stopped, or their time is over."""
        if self._ended_s is None:
            return False
        clear = all(keeper.is_clear for keeper in self._keepers.values())
        return clear or self._clock() - self._ended_s >= STOP_S

    def tick(self) -> None:
        """Advance the time. Call `command` with all commands received so far first."""
        was_there = self._robot.is_there
        self._robot.tick(self._clock())
        if was_there and not self._robot.is_there:
            self._silenced |= set(self._runs)
            self._cancel_all()
        for name in self._keepers:
            self._apply(name, lambda keeper, now_s: keeper.tick(now_s))
        for (op, key), fields in self._news.items():
            word = "run" if op == "feedback" else "topic"
            self._tell({"op": op, word: key, "fields": fields})
        self._news.clear()

    def _cancel_all(self) -> None:
        for run, name in list(self._runs.items()):
            self._apply(name, _cancelling(run))

    # -- ROS -----------------------------------------------------------------------------------

    def _applier(self, name: str) -> Callable[[Step], None]:
        return lambda step: self._apply(name, step)

    def _feedback(self, name: str) -> Callable[[bytes, dict[str, Any]], None]:
        def heard(goal_id: bytes, fields: dict[str, Any]) -> None:
            keeper = self._keepers[name]
            assert isinstance(keeper, GoalKeeper)
            run = keeper.run_of(goal_id)
            if run is not None and fields:
                self._news["feedback", run] = fields
            self._apply(name, lambda keeper, now_s: keeper.fed_back(goal_id, now_s))

        return heard

    def _listener(self, name: str, always: bool) -> Callable[[dict[str, Any]], None]:
        def heard(fields: dict[str, Any]) -> None:
            if always or self._heard.get(name) != fields:
                self._heard[name] = self._news["heard", name] = fields

        return heard

    def _apply(self, name: str, step: Step) -> None:
        """Let a keeper take one step, and carry out the resulting effects."""
        keeper = self._keepers[name]
        for effect in step(keeper, self._clock()):
            if isinstance(effect, RunEnded):
                self._end(effect)
            elif isinstance(effect, ServerTold):
                self._states[name] = effect
                for task in self._tasks[name]:
                    self._tell_state(task)
            elif isinstance(effect, RunWaits):
                self._tell({"op": "waits", "run": effect.run, "text": effect.text})
            else:
                try:
                    self._ends[name].carry_out(effect)
                except UnfitError as problem:
                    self._apply(name, _refusing(getattr(effect, "run", -1), str(problem)))

    def _tell_state(self, task: str) -> None:
        """Report whether a task can run: its server is up, and its lifecycle node active."""
        state, node = self._states.get(self._server_of[task]), self._nodes.get(task)
        if state is None:
            return
        if state.is_up and node is not None:
            active = self._states.get(_node_key(node), ServerTold(False, NOT_FOUND))
            if not active.is_up:
                state = ServerTold(False, f"waits for {node}, which {active.why}")
        if self._task_states.get(task) != state:
            self._task_states[task] = state
            self._tell({"op": "server", "task": task, "is_up": state.is_up, "why": state.why})

    def _end(self, effect: RunEnded) -> None:
        self._runs.pop(effect.run, None)
        # Feedback after the end is dropped.
        self._news.pop(("feedback", effect.run), None)
        how = effect.how
        if effect.run in self._silenced:
            self._silenced.discard(effect.run)
            how = "silenced" if how == "cancelled" else how
        told = {"run": effect.run, "how": how, "text": effect.text, "fields": effect.fields}
        self._tell({"op": "ended", **told})


def _servers(tasks: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Group tasks by their servers.

    Tasks of the same action become one, which reads all their fields. Lifecycle nodes are servers
    as well.
    """
    found: dict[str, dict[str, Any]] = {}
    for task in tasks:
        is_action = task["kind"] == "action"
        name = f"{task['type']} {task['name']}" if is_action else task["id"]
        one = found.setdefault(name, {**task, "ids": [], "feedback": [], "result": []})
        one["ids"].append(task["id"])
        one["feedback"] += task["feedback"]
        one["result"] += task["result"]
        if node := task["lifecycle"]:
            server = {"id": _node_key(node), "kind": LIFECYCLE, "name": node, "ids": []}
            found.setdefault(_node_key(node), server)["ids"].append(task["id"])
    return found


def _node_key(node: str) -> str:
    return f"{LIFECYCLE} {node}"


def _cancelling(run: int) -> Step:
    return lambda keeper, now_s: keeper.cancel(run, now_s)


def _refusing(run: int, text: str) -> Step:
    return lambda keeper, now_s: keeper.refused(run, text, now_s)
