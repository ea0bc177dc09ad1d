"""Background functions that fail, in virtual time: what that costs, and how they come back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotContext, RobotProgram, TaskContext
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON
from mrbt_mesh.runtime.backgrounds import failure_text
from mrbt_mesh.runtime.program_function import ProgramError
from mrbt_mesh.testing import MissionRun, run
from tests.support.paths import mission_file

EXPLORE = mission_file("explore")
NEVER = 10_000.0


def team(function: Callable[[TaskContext], Any], **costs: Any) -> tuple[RobotProgram, list[float]]:
    """A program whose work takes 4 s, with a background function; when that was begun on R1."""
    program, begun = RobotProgram(), list[float]()

    @program.local_task("*")
    async def work(task: TaskContext, *arguments: str) -> None:
        await anyio.sleep(4)

    @program.background(**costs)
    async def lidar(context: RobotContext) -> None:
        if context.robot == "R1":
            begun.append(context.unix_time_s())
            await function(context)

    return program, begun


def failing(*after_s: float) -> Callable[[TaskContext], Any]:
    """A sensor that fails so long after each start, then runs."""
    left = list(after_s)

    async def sense(task: TaskContext) -> None:
        if left:
            await anyio.sleep(left.pop(0))
            raise OSError("no device")
        await anyio.sleep(NEVER)

    return sense


def lines(found: MissionRun, word: str) -> list[str]:
    return [text for _, text in found.whole.observer.record.timeline if word in text]


def test_a_sensor_that_fails_costs_its_capability_until_it_runs_again() -> None:
    program, begun = team(failing(1.0), costs=["explore"])
    found = run(EXPLORE, program)
    assert found.result == "success"
    (fault,) = found.faults
    assert (fault.kind, fault.robot, fault.local_tasks) == ("minor", "R1", ("explore",))
    assert fault.reason.startswith("background function lidar failed: OSError: no device (")
    assert fault.reason.endswith("), restarted in 1 s")
    assert "test_backgrounds.py:" in fault.reason
    # Down for 1 s, and 1 s until it counts as running.
    assert fault.until_s is not None
    assert fault.until_s - fault.at_s == pytest.approx(2.0, abs=0.1)
    assert begun[1] - begun[0] == pytest.approx(2.0)
    assert lines(found, "R1 lost explore: background function lidar")
    assert lines(found, "R1 has explore again")
    # What R1 was at was cancelled, which is no failure.
    assert found.cancelled()[:1] == ["R1"]
    assert found.failed() == []


def test_the_pause_doubles_at_each_failure() -> None:
    program, begun = team(failing(0.5, 0.0, 0.0, 0.0), costs="all")
    found = run(EXPLORE, program)
    (fault,) = found.faults
    assert fault.local_tasks == ("explore",)
    starts = [later - begun[0] for later in begun]
    assert starts == pytest.approx([0.0, 1.5, 3.5, 7.5][: len(starts)], abs=0.01)
    assert len(starts) >= 3
    told = [text.rpartition(", ")[2] for text in lines(found, "R1 lost")]
    assert told[:3] == ["restarted in 1 s", "restarted in 2 s", "restarted in 4 s"]


def test_a_function_that_costs_nothing_is_a_problem_that_is_seen() -> None:
    program, _ = team(failing(1.0), costs="none")
    found = run(EXPLORE, program)
    assert found.faults == []
    (problem,) = found.summary["problems"]
    assert (problem["robot"], problem["subject"]) == ("R1", "background function lidar")
    assert problem["problem"].startswith("OSError: no device (test_backgrounds.py:")
    assert problem["until_s"] - problem["at_s"] == pytest.approx(2.0, abs=0.1)
    assert found.cancelled() == []


def test_a_function_that_returns_has_ended() -> None:
    async def once(task: TaskContext) -> None:
        await anyio.sleep(0.1)

    program, begun = team(once)
    found = run(EXPLORE, program)
    assert (found.result, found.faults, len(begun)) == ("success", [], 1)


def test_by_default_it_costs_all_and_the_program_does_not_restore_it() -> None:
    async def sense(task: TaskContext) -> None:
        await anyio.sleep(0.5)
        task.restore_capability("explore")
        raise OSError("no device")

    program, _ = team(sense)

    @program.background(costs="none")
    async def hopeful(context: RobotContext) -> None:
        while True:
            context.restore_capability("all")
            await anyio.sleep(0.2)

    found = run(EXPLORE, program)
    (fault,) = found.faults
    assert (fault.robot, fault.until_s) == ("R1", None)
    assert found.result == "success"


@pytest.mark.parametrize("costs", ["explore", 7, [1], [None]])
def test_what_it_costs_is_checked(costs: Any) -> None:
    program = RobotProgram()
    with pytest.raises(ProgramError, match="a list of local tasks"):

        @program.background(costs=costs)
        async def lidar(context: RobotContext) -> None: ...


def test_a_long_reason_keeps_its_place_and_when_it_is_restarted() -> None:
    text = failure_text("lidar failed: ", "OSError: " + 300 * "x" + " (robot.py:12)", 4.0)
    assert len(text) == MAX_REASON
    assert text.endswith("x… (robot.py:12), restarted in 4 s")
    assert failure_text("lidar failed: ", "no power", 1) == (
        "lidar failed: no power, restarted in 1 s"
    )
