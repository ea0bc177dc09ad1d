"""The robots of examples/inspection: the leaves of a BehaviorTree.CPP tree, and one local task."""

import anyio
from simulated import work

from mrbt_mesh import RobotProgram, TaskContext, TaskFailedError
from mrbt_mesh.btcpp import InOut, Out

robot = RobotProgram(record_work=True)


@robot.action("DriveTo")
async def drive_to(task: TaskContext, goal: str, tries: InOut[int]) -> None:
    """Take a second; the first time to valve 3 something is in the way."""
    tries.set((tries.value or 0) + 1)
    await anyio.sleep(1 / task.simulation.speed)
    if goal == "3" and not tries.value:
        raise TaskFailedError("something is in the way")


@robot.action("BackUp")
async def back_up(task: TaskContext, distance_m: float) -> None:
    """Drive back a little."""
    await anyio.sleep(distance_m / task.simulation.speed)


@robot.action("ReadGauge")
async def read_gauge(task: TaskContext, valve: str, pressure_bar: Out[float]) -> None:
    """Look at the gauge, which says what the mission file says."""
    await anyio.sleep(0.5 / task.simulation.speed)
    pressure_bar.set(task.parameters["pressures_bar"][valve])


@robot.local_task
async def close(task: TaskContext, valve: str) -> None:
    """Turn the handwheel."""
    await work(task)
