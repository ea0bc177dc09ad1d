"""A local task that is a tree, over one robot's own facts: it does what a team of one does."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.local_run import LocalConditions, LocalRun
from mrbt_mesh.core.bt.tree import NodeSpec, Status, build_tree
from tests.support.btcpp.conformance import at_first, team_run, team_tree, told, traces
from tests.support.build import action, condition, fallback, parallel, retry, sequence, timeout
from tests.support.effort import at_size


class Robot:
    """A tree and the facts of the robot that ticks it."""

    def __init__(self, spec: NodeSpec, *holding: str) -> None:
        self.conditions = LocalConditions(lambda name: name in holding)
        self.run = LocalRun(build_tree(spec), self.conditions)
        self.conditions.watchers.append(self.run.turned)

    def set(self, name: str, value: bool) -> None:
        self.conditions.set(name, value)

    def outcome(self, activation: str, success: bool) -> None:
        self.run.ended(activation, success)

    def tick(self) -> Evaluation:
        return self.run.tick()

    @property
    def status(self) -> Status:
        return self.tick().status

    @property
    def asked(self) -> list[str]:
        return [request.subject for request in self.tick().requests]

    def end(self, subject: str, success: bool = True) -> None:
        (activation,) = (r.activation for r in self.tick().requests if r.subject == subject)
        self.outcome(activation, success)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["tame", "mid", "free"])
def test_a_robot_does_with_a_tree_what_a_team_of_one_does(family: str) -> None:
    # That is what BehaviorTree.CPP does, or else a note says why not: test_team_tree_traces.
    compared = 0
    tried = traces()[:: at_size(quick=3, gate=1)]
    for trace in tried:
        team = team_tree(trace)
        if trace.family == family and team.spec is not None and not trace.error:
            compared += 1
            robot = Robot(team.spec, *at_first(trace))
            assert told(robot, team.spec, trace) == team_run(team.spec, trace), trace.id
    assert compared > len(tried) // 5


def test_the_status_of_the_tree_is_the_outcome() -> None:
    for success, status in ((True, Status.SUCCESS), (False, Status.FAILURE)):
        robot = Robot(sequence(action("grasp"), action("turn")))
        robot.end("grasp")
        assert (robot.status, robot.asked) == (Status.RUNNING, ["turn"])
        robot.end("turn", success)
        assert (robot.status, robot.asked) == (status, [])


def test_only_nodes_right_of_an_action_read_the_conditions_that_it_has_set() -> None:
    robot = Robot(sequence(action("diagnose"), condition("broken"), action("fix")))
    (diagnose,) = robot.tick().requests
    assert robot.run.returned(diagnose.activation, True, {"broken": True}) is Status.RUNNING
    robot.set("broken", True)
    assert robot.asked == ["fix"]
    robot = Robot(sequence(fallback(condition("held"), action("pick")), action("place")), "held")
    (place,) = robot.tick().requests
    assert robot.run.returned(place.activation, True, {"held": False}) is Status.SUCCESS


def test_attempts_and_time_limits() -> None:
    robot = Robot(retry(2, timeout(1.0, parallel(1, action("look"), action("listen")))))
    for _ in range(2):
        assert robot.asked == ["look", "listen"]
        (limit,) = robot.tick().timeouts
        robot.run.expired(limit.activation)
    assert robot.status is Status.FAILURE
