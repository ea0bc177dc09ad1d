"""The bridge between a robot and ROS: what is wanted, told, and done when the robot is silent."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.adapters.ros2.bridge.bridge import STOP_S, Bridge
from mrbt_mesh.adapters.ros2.bridge.calls import WAITS_S
from mrbt_mesh.adapters.ros2.bridge.goals import CANCELED, SUCCEEDED
from mrbt_mesh.adapters.ros2.bridge.server import (
    AskLife,
    CancelGoal,
    SendCall,
    SendGoal,
    ServerEffect,
)
from mrbt_mesh.adapters.ros2.bridge.values import UnfitError

GOAL = b"g" * 16
TASK: dict[str, Any] = {"lifecycle": None, "feedback": [], "result": []}
BIND: dict[str, Any] = {
    "detection_s": 1.0,
    "tasks": [
        TASK | {"id": "go", "kind": "action", "type": "p/action/Go", "name": "/go"},
        TASK | {"id": "look", "kind": "srv", "type": "p/srv/Look", "name": "/look"},
    ],
    "topics": [{"id": "condition/near", "always": False}, {"id": "until/look", "always": True}],
}


class Robot:
    """A bridge on a clock of the test, with ends that keep what they are told to do."""

    def __init__(self, bind: dict[str, Any] = BIND) -> None:
        self.now_s = 0.0
        self.served: list[dict[str, Any]] = []
        self.told: list[dict[str, Any]] = []
        self.done: list[tuple[str, ServerEffect]] = []
        self.apply: dict[str, Any] = {}
        self.feedback: dict[str, Any] = {}
        self.topics: dict[str, Any] = {}
        self.unfit = ""
        self.bridge = Bridge(bind, self.told.append, lambda: self.now_s)
        self.bridge.connect(self)

    def serve(self, task: dict[str, Any], apply: Any, feedback: Any) -> Any:
        self.served.append(task)
        self.apply[task["id"]], self.feedback[task["id"]] = apply, feedback
        return _End(self, task["id"])

    def listen(self, topic: dict[str, Any], told: Any) -> None:
        self.topics[topic["id"]] = told

    def hear(self, name: str = "go") -> None:
        self.apply[name](lambda keeper, now_s: keeper.heard(now_s))

    def start(self, run: int = 1, name: str = "go") -> None:
        words = {"op": "start", "task": name, "run": run, "goal_id": GOAL, "body": {"x": 1}}
        self.bridge.command(words)

    def accept(self) -> None:
        self.apply["go"](lambda keeper, now_s: keeper.answered(GOAL, True, now_s))

    def end(self, status: int) -> None:
        self.apply["go"](lambda k, now_s: k.result(GOAL, status, "why", {"n": 1}, now_s))

    def pass_time(self, seconds: float, beats: bool = True) -> None:
        for _ in range(round(seconds / 0.05)):
            self.now_s += 0.05
            if beats:
                self.bridge.command({"op": "beat"})
            self.hear()
            self.bridge.tick()

    def news(self, op: str) -> list[dict[str, Any]]:
        return [each for each in self.told if each["op"] == op]


class _End:
    def __init__(self, robot: Robot, name: str) -> None:
        self.robot, self.name = robot, name

    def carry_out(self, effect: ServerEffect) -> None:
        if self.robot.unfit and isinstance(effect, SendGoal | SendCall):
            raise UnfitError(self.robot.unfit)
        self.robot.done.append((self.name, effect))


def test_a_goal_its_feedback_and_its_end() -> None:
    robot = Robot()
    robot.hear()
    assert robot.told == [{"op": "server", "task": "go", "is_up": True, "why": ""}]
    robot.start()
    assert ("go", SendGoal(1, GOAL, {"x": 1})) in robot.done
    robot.accept()
    for left in (3, 2, 1):
        robot.feedback["go"](GOAL, {"left": left})
    robot.feedback["go"](b"of another", {"left": 9})
    robot.pass_time(0.05)
    # The newest is enough.
    assert robot.news("feedback") == [{"op": "feedback", "run": 1, "fields": {"left": 1}}]
    robot.feedback["go"](GOAL, {"left": 0})
    robot.end(SUCCEEDED)
    told = {"run": 1, "how": "succeeded", "text": "why", "fields": {"n": 1}}
    assert robot.news("ended") == [{"op": "ended", **told}]
    robot.pass_time(0.1)
    assert len(robot.news("feedback")) == 1


def test_the_robot_is_answered() -> None:
    robot = Robot()
    robot.bridge.command({"op": "beat"})
    assert robot.told == [{"op": "beat"}]


def test_a_cancelled_goal() -> None:
    robot = Robot()
    robot.hear()
    robot.start()
    robot.accept()
    robot.bridge.command({"op": "cancel", "run": 1})
    assert robot.done[-1] == ("go", CancelGoal(GOAL))
    robot.bridge.command({"op": "cancel", "run": 99})
    robot.end(CANCELED)
    assert [each["how"] for each in robot.news("ended")] == ["cancelled"]


def test_a_goal_that_the_type_cannot_say_has_failed() -> None:
    robot = Robot()
    robot.hear()
    robot.unfit = "pose: there is no field 'positon'"
    robot.start()
    assert [(e["how"], e["text"]) for e in robot.news("ended")] == [("unfit", robot.unfit)]


def test_the_goals_of_a_robot_that_stands_still_are_cancelled() -> None:
    robot = Robot()
    robot.hear()
    robot.start()
    robot.accept()
    robot.pass_time(3.0)
    assert not [e for _, e in robot.done if isinstance(e, CancelGoal)]
    robot.pass_time(1.2, beats=False)
    assert ("go", CancelGoal(GOAL)) in robot.done
    robot.end(CANCELED)
    assert [each["how"] for each in robot.news("ended")] == ["silenced"]
    # It goes on, and is served as before.
    robot.start(run=2)
    assert ("go", SendGoal(2, GOAL, {"x": 1})) in robot.done


def test_what_is_left_is_cancelled_when_the_robot_is_gone() -> None:
    robot = Robot()
    robot.hear()
    robot.start()
    robot.accept()
    assert not robot.bridge.is_over
    robot.bridge.robot_gone()
    assert robot.done[-1] == ("go", CancelGoal(GOAL))
    assert not robot.bridge.is_over
    robot.end(CANCELED)
    assert robot.bridge.is_over


def test_a_server_that_does_not_stop_does_not_keep_the_bridge() -> None:
    robot = Robot()
    robot.hear()
    robot.start()
    robot.accept()
    robot.bridge.robot_gone()
    robot.pass_time(STOP_S + 0.1, beats=False)
    assert robot.bridge.is_over


def test_goals_of_an_earlier_bridge() -> None:
    robot = Robot()
    robot.bridge.command({"op": "forget", "task": "go", "run": 9, "goal_id": GOAL})
    robot.hear()
    assert robot.done == [("go", CancelGoal(GOAL))]
    assert robot.told == []
    robot.end(CANCELED)
    assert [(e["run"], e["how"]) for e in robot.news("ended")] == [(9, "cancelled")]


def test_of_topics_what_has_changed_is_told_and_what_is_waited_for_always() -> None:
    robot = Robot()
    for _ in range(2):
        for name in ("condition/near", "until/look"):
            robot.topics[name]({"data": 1})
        robot.pass_time(0.05)
    assert [each["topic"] for each in robot.news("heard")] == [
        *("condition/near", "until/look"),
        "until/look",
    ]
    robot.topics["condition/near"]({"data": 2})
    robot.pass_time(0.05)
    assert robot.told[-1] == {"op": "heard", "topic": "condition/near", "fields": {"data": 2}}


@pytest.mark.parametrize("name", ["go", "look"])
def test_servers_that_are_silent_are_asked_and_told(name: str) -> None:
    robot = Robot()
    robot.hear(name)
    for _ in range(30):
        robot.now_s += 0.05
        robot.bridge.tick()
    assert (name, AskLife()) in robot.done
    lost = [e for e in robot.news("server") if e["task"] == name and not e["is_up"]]
    assert [each["why"] for each in lost] == ["does not answer"]


def test_two_tasks_on_one_action_server_have_one_keeper() -> None:
    go, look = BIND["tasks"]
    more = {"id": "fetch", "feedback": [["left", []]]}
    robot = Robot(BIND | {"tasks": [go, look, go | more]})
    assert [each["ids"] for each in robot.served] == [["go", "fetch"], ["look"]]
    assert robot.served[0]["feedback"] == [["left", []]]
    robot.hear()
    assert [each["task"] for each in robot.news("server")] == ["go", "fetch"]
    robot.start(1)
    robot.bridge.command(
        {"op": "start", "task": "fetch", "run": 2, "goal_id": b"h" * 16, "body": {}}
    )
    sent = [effect for _, effect in robot.done if isinstance(effect, SendGoal)]
    assert sent == [SendGoal(1, GOAL, {"x": 1})]
    robot.accept()
    robot.end(SUCCEEDED)
    sent = [effect for _, effect in robot.done if isinstance(effect, SendGoal)]
    assert [each.run for each in sent] == [1, 2]


def test_a_call_without_an_answer_is_told_once() -> None:
    robot = Robot()
    robot.hear("look")
    robot.start(1, "look")
    for _ in range(3):
        robot.now_s += WAITS_S
        robot.hear("look")
    (told,) = robot.news("waits")
    assert told["text"] == "no answer for 10 s, and it cannot be asked again"


def test_a_lifecycle_node_counts_for_the_tasks_that_need_it() -> None:
    go, look = BIND["tasks"]
    robot = Robot(BIND | {"tasks": [go, go | {"id": "fetch", "lifecycle": "/nav"}, look]})
    robot.hear()
    said = {each["task"]: (each["is_up"], each["why"]) for each in robot.news("server")}
    waits = "waits for /nav, which has not been found"
    assert said == {"go": (True, ""), "fetch": (False, waits)}
    robot.told.clear()
    robot.hear("lifecycle /nav")
    robot.apply["lifecycle /nav"](lambda keeper, _: keeper.unusable("is inactive"))
    assert [(each["task"], each["why"]) for each in robot.news("server")] == [
        ("fetch", ""),
        ("fetch", "waits for /nav, which is inactive"),
    ]
