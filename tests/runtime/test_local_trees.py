"""Local tasks that are trees, carried out by a program: on a clock of its own, without a team."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotContext, RobotProgram, TaskContext, TaskFailedError
from mrbt_mesh.core.agent.effects import CancelAction, StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished, ActionStopped
from mrbt_mesh.core.bt.tree import NodeSpec, Status, build_tree
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.runtime.actions import ActionRunner, RobotIdentity
from mrbt_mesh.runtime.program_loader import check_program
from mrbt_mesh.sim.world.clock import VirtualClock, VirtualLoop
from tests.support.action_host import Host
from tests.support.build import (
    action,
    condition,
    fallback,
    make_mission,
    parallel,
    retry,
    sequence,
    task,
    timeout,
)

Steps = Callable[[ActionRunner, "Host"], Any]


IDLE, RUNNING, SUCCESS, FAILURE = Status


class Story:
    """A program whose actions take a second; it notes what becomes of them."""

    def __init__(self, *failing: str, **sets: str) -> None:
        self.told: list[str] = []
        self.stop_s = 0.0
        self.program = RobotProgram()

        @self.program.local_task("*")
        async def act(task: TaskContext) -> None:
            name = task.local_task
            try:
                await anyio.sleep(5 if name == "wait" else 1)
            except BaseException:
                with anyio.CancelScope(shield=True):
                    await anyio.sleep(self.stop_s)
                self.told.append(f"{task.unix_time_s():g} {name} cancelled")
                raise
            self.told.append(f"{task.unix_time_s():g} {name}")
            if name in failing:
                raise TaskFailedError("does not fit")
            for change in sets.get(name, "").split():
                task.set_local_condition(change.lstrip("-"), not change.startswith("-"))
            task.set_condition("told", True)


def mission_of(tree: NodeSpec) -> Mission:
    mission = make_mission(
        action("whole"), {"R1": {"whole": 1.0}}, [task("whole", ("whole", 1, 1))]
    )
    own = {name: ConditionType(name) for name in ("c1", "c2")}
    told, trees = {"told": ConditionType("told")}, {"whole": build_tree(tree)}
    return replace(mission, conditions=told, local_trees=trees, local_conditions=own)


def play(tree: NodeSpec, story: Story, steps: Steps | None = None) -> Host:
    """Carry the local task out, in virtual time."""
    clock = VirtualClock()
    host = Host(clock)

    async def main() -> None:
        async with anyio.create_task_group() as group:
            identity = RobotIdentity("R1", "T", 1, 1.0)
            runner = ActionRunner(group, story.program, mission_of(tree), identity, host)
            start = StartAction(7, "r:1:whole::0", "whole", "whole", (), 1, Incarnation(1, "n"))
            runner.carry_out(start)
            if steps is not None:
                await steps(runner, host)

    anyio.run(main, backend_options={"loop_factory": lambda: VirtualLoop(clock)})
    return host


def outcome(host: Host) -> bool:
    (end,) = host.said
    assert isinstance(end, ActionFinished)
    return end.success


def test_its_status_is_the_outcome_with_data_and_conditions_of_its_actions() -> None:
    story = Story()
    host = play(sequence(action("a"), action("b")), story)
    assert host.said == [ActionFinished(7, True, (("told", True),))]
    assert story.told == ["1 a", "2 b"]


def test_the_statuses_of_its_nodes_are_told_when_they_change() -> None:
    host = play(sequence(fallback(action("a"), action("b")), condition("c1")), Story("a"))
    assert host.ticked == [
        bytes([RUNNING, RUNNING, RUNNING, IDLE, IDLE]),
        bytes([RUNNING, RUNNING, FAILURE, RUNNING, IDLE]),
    ]


def test_a_failure_is_logged_and_the_tree_decides_what_it_means() -> None:
    story = Story("a")
    host = play(fallback(action("a"), action("b")), story)
    assert outcome(host)
    assert [(row["level"], row["action"], row["error"]) for row in host.logged] == [
        ("warning", "a", "does not fit"),
        ("info", "b", ""),
    ]
    assert not outcome(play(retry(2, action("a")), Story("a")))


def test_a_parallel_stops_what_it_no_longer_needs_before_the_local_task_ends() -> None:
    story = Story()
    tree = parallel(1, sequence(action("a"), action("b")), timeout(9, action("wait")))
    assert outcome(play(tree, story))
    assert story.told == ["1 a", "2 b", "2 wait cancelled"]


def test_conditions_of_an_action_come_after_its_outcome() -> None:
    """Else place would undo, in its own last step, what made it possible, for ever."""
    tree = sequence(fallback(condition("c1"), action("pick")), action("place"))
    story = Story(pick="c1", place="-c1")
    assert outcome(play(tree, story))
    assert story.told == ["1 pick", "2 place"]


def test_what_stands_right_of_an_action_reads_the_conditions_that_it_has_set() -> None:
    story = Story(diagnose="c1")
    tree = sequence(action("diagnose"), condition("c1"), action("fix"))
    assert outcome(play(tree, story))
    assert story.told == ["1 diagnose", "2 fix"]


@pytest.mark.parametrize(
    ("stop_s", "expected"),
    [
        (0.0, ["1 pick", "1.5 use cancelled", "2.5 pick", "3.5 use"]),
        (0.2, ["1 pick", "1.7 use cancelled", "2.7 pick", "3.7 use"]),
    ],
    ids=["at once", "the next action begins when it has stopped"],
)
def test_a_condition_that_a_sensor_sets_takes_an_action_back(
    stop_s: float, expected: list[str]
) -> None:
    tree = sequence(fallback(condition("c1"), action("pick")), action("use"))
    story = Story(pick="c1")
    story.stop_s = stop_s

    @story.program.background
    async def slip(context: RobotContext) -> None:
        await anyio.sleep(1.5)
        context.set_local_condition("c1", False)

    async def steps(runner: ActionRunner, host: Host) -> None:
        runner.start_background()

    assert outcome(play(tree, story, steps))
    assert story.told == expected


def test_a_time_limit() -> None:
    story = Story()
    tree = fallback(timeout(0.5, action("a")), action("b"))
    assert outcome(play(tree, story))
    assert story.told == ["0.5 a cancelled", "1.5 b"]


def test_cancelled_it_stops_its_actions_first_and_says_so_once() -> None:
    story = Story()

    async def steps(runner: ActionRunner, host: Host) -> None:
        await anyio.sleep(0.5)
        runner.carry_out(CancelAction(7))

    host = play(parallel(2, action("a"), action("b")), story, steps)
    assert host.said == [ActionStopped(7)]
    assert story.told == ["0.5 a cancelled", "0.5 b cancelled"]


def test_a_process_that_ends_takes_its_tree_along() -> None:
    story = Story()

    async def steps(runner: ActionRunner, host: Host) -> None:
        await anyio.sleep(0.5)
        runner._group.cancel_scope.cancel()

    host = play(parallel(2, action("a"), action("b")), story, steps)
    assert host.said == []
    assert sorted(story.told) == ["0.5 a cancelled", "0.5 b cancelled"]


def test_a_program_needs_the_actions_of_the_tree_and_not_the_local_task() -> None:
    program = RobotProgram()
    mission = mission_of(sequence(action("a"), action("b")))

    @program.local_task("a")
    async def a(task: TaskContext) -> None: ...

    lacking = check_program(program, mission, ["whole"])
    assert lacking == [
        'no function for the local task b (in the tree of whole); add @robot.local_task("b")'
    ]
