"""What robots' programs say of why something failed, as it goes to the team."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext, TaskFailedError
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished, Input
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON, FailureReason, one_line
from mrbt_mesh.runtime.actions import ActionRunner, RobotIdentity
from tests.support.action_host import Host
from tests.support.build import action, make_mission


def end_of(program: RobotProgram) -> ActionFinished:
    """How the local task `work` ends."""
    mission = make_mission(action("work"))
    told = FailureReason("local_task", "work", (), "equals", "stuck")
    mission = replace(mission, conditions={"told": ConditionType("told", failure=told)})

    async def run() -> list[Input]:
        host = Host()
        async with anyio.create_task_group() as group:
            identity = RobotIdentity("R1", "T", 1, 1.0)
            runner = ActionRunner(group, program, mission, identity, host)
            runner.carry_out(
                StartAction(7, "r:0:work::0", "work", "work", (), 1, Incarnation(1, "n"))
            )
        return host.said

    (end,) = anyio.run(run)
    assert isinstance(end, ActionFinished)
    return end


def raising(error: Exception) -> RobotProgram:
    program = RobotProgram()

    @program.local_task("work")
    async def work(task: TaskContext) -> None:
        raise error

    return program


def test_a_failure_with_a_reason() -> None:
    end = end_of(raising(TaskFailedError("no path to dock")))
    assert (end.success, end.reason, end.error) == (False, "no path to dock", "no path to dock")


def test_a_failure_without() -> None:
    assert end_of(raising(TaskFailedError())).reason == ""


def test_false_is_a_failure_without() -> None:
    program = RobotProgram()

    @program.local_task("work")
    async def work(task: TaskContext) -> bool:
        return False

    end = end_of(program)
    assert (end.success, end.reason) == (False, "")


def line_of(function: Any) -> int:
    return int(function.__code__.co_firstlineno)


def test_an_exception_is_told_with_file_and_line_of_the_program() -> None:
    """Of the program, not of what it calls elsewhere."""
    program = RobotProgram()

    @program.local_task("work")
    async def work(task: TaskContext) -> None:
        anyio.CapacityLimiter(-1)

    end = end_of(program)
    line = line_of(work) + 2
    assert end.reason.endswith(f" (test_actions_reasons.py:{line})")
    assert end.reason.startswith("ValueError: ")
    assert "Traceback" in end.error


def test_of_a_class_too() -> None:
    program = RobotProgram()

    @program.local_task("work")
    class Work:
        async def run(self, task: TaskContext) -> None:
            {}["grip"]

    where = f"(test_actions_reasons.py:{line_of(Work.run) + 1})"
    assert end_of(program).reason == f"KeyError: 'grip' {where}"


@pytest.mark.parametrize("text", ["x" * 5 * MAX_REASON, "a\nb", "", "   "])
def test_long_and_strange_texts_keep_their_place(text: str) -> None:
    reason = end_of(raising(RuntimeError(text))).reason
    assert reason.startswith("RuntimeError")
    assert "test_actions_reasons.py:" in reason
    assert reason == one_line(reason)


def test_a_program_without_the_local_task() -> None:
    assert end_of(RobotProgram()).reason == "the robot's program has no local task 'work'"


def test_a_program_does_not_set_what_follows_from_failures() -> None:
    program = RobotProgram()

    @program.local_task("work")
    async def work(task: TaskContext) -> None:
        task.set_condition("told", True)

    assert "fail with such a reason instead" in end_of(program).reason
