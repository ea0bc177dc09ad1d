"""A task's surroundings, for calling a robot program's functions directly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import anyio

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.runtime.actions import perform
from mrbt_mesh.runtime.context import Simulation
from mrbt_mesh.runtime.program import functions_of
from mrbt_mesh.runtime.user_code import UserCall


@dataclass
class FakePort:
    """A TaskPort that remembers all reports; what it lacks, a program must not call."""

    events: list[dict[str, Any]] = field(default_factory=list)
    progress: list[float] = field(default_factory=list)
    conditions: dict[str, bool] = field(default_factory=dict)
    now_s: float = 1000.0

    def set_condition(self, name: str, value: bool, at_once: bool) -> None:
        assert not at_once
        self.conditions[name] = value

    def set_conditions(self, values: Mapping[str, bool]) -> None:
        self.conditions |= values

    def read_condition(self, name: str) -> bool:
        return self.conditions.get(name, False)

    def report_position(self, x: float, y: float, heading: float | None) -> None:
        pass

    def report_progress(self, fraction: float) -> None:
        self.progress.append(fraction)

    def __getattr__(self, name: str) -> Any:
        raise AssertionError(f"the program calls {name}")

    def record_event(self, event: Mapping[str, Any]) -> None:
        self.events.append(dict(event))

    def unix_time_s(self) -> float:
        self.now_s += 1
        return self.now_s


def context(port: Any, local_task: str, *arguments: str, **changes: Any) -> TaskContext:
    """A context of a robot with this one local task; `port` hears what its program reports."""
    given = {
        "robot": "A1",
        "robot_type": "A",
        "capabilities": (local_task,),
        "parameters": {},
        "simulation": Simulation(pid=42),
        "_port": port,
        "incarnation": "7-abc",
        "activation": "act-1",
        "global_task": "goal",
        "local_task": local_task,
        "arguments": arguments,
        "partners": (),
        "performance": 1e6,
    }
    return TaskContext(**{**given, **changes})


async def run(program: RobotProgram, task: TaskContext) -> bool:
    """Whether the program's function for a local task succeeds; raises UserCodeError."""
    function = functions_of(program).local_task(task.local_task.partition("(")[0])
    assert function is not None
    call = UserCall(task.local_task, function, partial(function, task, *task.arguments))
    return await perform(call, task, task._port, "start" if program.record_work else "")


def outcomes(port: FakePort) -> list[tuple[str, str | None]]:
    """What has been recorded: (event, outcome)."""
    return [(event["event"], event["outcome"]) for event in port.events]


async def cancelled_while_working(program: RobotProgram, task: TaskContext) -> bool:
    """Start the task, cancel it, and say whether the scope caught the cancellation."""
    async with anyio.create_task_group() as group:
        scope = anyio.CancelScope()

        async def work() -> None:
            with scope:
                await run(program, task)

        group.start_soon(work)
        # Three turns of the loop start the task, which then waits for what never comes.
        for _ in range(3):
            await anyio.lowlevel.checkpoint()
        scope.cancel()
    return scope.cancelled_caught


class Told:
    """A port that keeps what a program says."""

    def __init__(self) -> None:
        self.said: list[tuple[Any, ...]] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self.said.append((name, *arguments))
