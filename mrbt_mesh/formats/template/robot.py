"""What a robot of this team can do: one async function per local task of mission.yaml."""

import anyio

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)  # starts and ends are in the run's events.jsonl


@robot.local_task
async def look_at(task: TaskContext, box: str) -> None:
    """The team hears what was found in one step with the success. To fail: raise."""
    await anyio.sleep(task.simulation.duration_s)  # in place of a camera
    task.set_condition(f"heavy({box})", box in task.parameters["heavy_boxes"])


@robot.local_task
async def carry(task: TaskContext, box: str) -> None:
    """Together with task.partners. When the plan changes, any await may be cancelled."""
    await anyio.sleep(task.simulation.duration_s)  # in place of a gripper
