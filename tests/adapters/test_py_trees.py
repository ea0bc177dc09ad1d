"""Trees of py_trees as local tasks, run by the library itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.agent.effects import CancelAction, StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished, ActionStopped
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.runtime.actions import ActionRunner, RobotIdentity
from mrbt_mesh.runtime.program import ProgramError
from mrbt_mesh.sim import Kill, simulate
from mrbt_mesh.sim.world.clock import VirtualClock, VirtualLoop
from tests.support.action_host import Host
from tests.support.build import action, make_mission, sequence
from tests.support.extras import said_without

py_trees = pytest.importorskip(
    "py_trees", reason="py_trees is not installed: make test-interop, or pip install py_trees"
)
adapter = pytest.importorskip("mrbt_mesh.adapters.py_trees")
Access, Status = py_trees.common.Access, py_trees.common.Status


class Drive(py_trees.behaviour.Behaviour):  # type: ignore[misc]
    """Takes ticks; what it does is told to `said`."""

    def __init__(self, said: list[str], ticks: int = 3, ends: Any = Status.SUCCESS) -> None:
        super().__init__("drive")
        self.said, self.ticks, self.ends = said, ticks, ends
        self.board = self.attach_blackboard_client("drive")
        self.board.register_key("goal", access=Access.READ)
        self.board.register_key("done", access=Access.EXCLUSIVE_WRITE)

    def setup(self, **given: Any) -> None:
        self.said.append(f"setup for {given['task'].local_task}")

    def initialise(self) -> None:
        self.left = self.ticks
        self.said.append(f"drive to {self.board.goal}")

    def update(self) -> Any:
        self.left -= 1
        if self.left > 0:
            return Status.RUNNING
        self.feedback_message = "stuck at the door" if self.ends is Status.FAILURE else ""
        self.board.done = True
        return self.ends

    def terminate(self, new_status: Any) -> None:
        self.said.append(f"left with {new_status.name}")

    def shutdown(self) -> None:
        self.said.append("shutdown")


def tree_of(*behaviours: Any) -> Any:
    root = py_trees.composites.Sequence("root", memory=True)
    root.add_children(behaviours)
    return root


def carried_out(
    function: Any, cancel_s: float = 0, arguments: tuple[str, ...] = ("dock",)
) -> tuple[Any, float]:
    """How the local task `go(dock)` ends, and when."""
    robot = RobotProgram()
    robot.local_task("go")(function)
    ground = f"go({','.join(arguments)})"
    clock = VirtualClock()
    host = Host(clock)

    async def main() -> None:
        async with anyio.create_task_group() as group:
            identity = RobotIdentity("A1", "a", 1, 1.0)
            runner = ActionRunner(group, robot, make_mission(action(ground)), identity, host)
            start = StartAction(7, "g#0", "g", ground, (), MICRO, Incarnation(1, "n"))
            runner.carry_out(start)
            if cancel_s:
                await anyio.sleep(cancel_s)
                runner.carry_out(CancelAction(7))

    anyio.run(main, backend_options={"loop_factory": lambda: VirtualLoop(clock)})
    (said,) = host.said
    return said, clock.now_us / 1e6


def test_a_tree_is_ticked_at_its_rate_until_it_succeeds() -> None:
    said: list[str] = []
    function = adapter.local_task(lambda: tree_of(Drive(said)), arguments=["goal"], rate_hz=4)
    end, at_s = carried_out(function)
    assert isinstance(end, ActionFinished)
    assert (end.success, at_s) == (True, 0.5)
    assert said[:3] == ["setup for go(dock)", "drive to dock", "left with SUCCESS"]
    assert said[-1] == "shutdown"


def test_a_failure_says_what_the_behaviour_said() -> None:
    silent = py_trees.behaviours.Failure("never")
    for behaviour, reason in (
        (lambda: Drive([], ends=Status.FAILURE), "drive: stuck at the door"),
        (lambda: silent, "never: failure"),
    ):
        end, _ = carried_out(
            adapter.local_task(lambda b=behaviour: tree_of(b()), arguments=["goal"])
        )
        assert (end.success, end.error) == (False, reason)


def test_a_tree_that_is_cancelled_is_stopped_as_invalid() -> None:
    said: list[str] = []
    function = adapter.local_task(lambda: tree_of(Drive(said, ticks=99)), arguments=["goal"])
    end, at_s = carried_out(function, cancel_s=0.35)
    assert (end, at_s) == (ActionStopped(7), 0.35)
    assert said[-2:] == ["left with INVALID", "shutdown"]


def test_one_tree_may_serve_run_after_run() -> None:
    said: list[str] = []
    tree = py_trees.trees.BehaviourTree(Drive(said))
    function = adapter.local_task(tree, arguments=["goal"])
    for _ in range(2):
        assert carried_out(function)[0].success
    assert said.count("drive to dock") == 2


def test_an_error_in_a_behaviour_is_the_programs_and_the_tree_is_stopped() -> None:
    said: list[str] = []

    class Broken(Drive):
        def update(self) -> Any:
            raise KeyError("grip")

    end, _ = carried_out(adapter.local_task(lambda: tree_of(Broken(said)), arguments=["goal"]))
    assert not end.success
    assert "KeyError: 'grip'" in end.error
    assert said[-1] == "shutdown"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: adapter.local_task(5), "a Behaviour or BehaviourTree of py_trees is expected"),
        (lambda: adapter.local_task(lambda: None, rate_hz=0), "ticks a second"),
    ],
)
def test_what_is_no_tree_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        make()


def test_arguments_have_to_fit() -> None:
    end, _ = carried_out(adapter.local_task(lambda: tree_of(Drive([]))))
    assert not end.success
    assert "has 1 arguments, and its tree of py_trees names 0" in end.error


def test_robots_of_one_process_have_blackboards_of_their_own() -> None:
    """Two robots run the same tree at once in the simulator; one dies, and is replaced."""
    seen: set[tuple[str, str]] = set()

    class Look(Drive):
        def setup(self, **given: Any) -> None:
            task: TaskContext = given["task"]
            self.arguments = task.arguments

        def update(self) -> Any:
            seen.add((self.board.goal, *self.arguments))
            return super().update()

    robot = RobotProgram()
    run = adapter.local_task(lambda: tree_of(Look([], ticks=20)), arguments=["goal"])
    robot.local_task("go")(run)
    capabilities = {"go(dock)": 1.0, "go(gate)": 1.0}
    both = sequence(action("go(dock)"), action("go(gate)"))
    parallel = replace(both, kind=Kind.PARALLEL, limit=2)
    mission = make_mission(parallel, {"A": capabilities, "B": capabilities})
    result = simulate(mission, robot, seed=1, schedule=[(MICRO, Kill("A"))], timeout_us=60 * MICRO)
    assert result.result == "success"
    assert seen == {("dock", "dock"), ("gate", "gate")}
    assert py_trees.blackboard.Blackboard.storage == {}


def test_without_the_library_it_says_what_to_install() -> None:
    call = "local_task(lambda: None)"
    said = said_without("py_trees", "mrbt_mesh.adapters.py_trees", call)
    assert "pip install 'mrbt-mesh[py_trees]'" in said
