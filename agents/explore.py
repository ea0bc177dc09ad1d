"""The robots of examples/explore."""

from simulated import physical, work

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram()


@robot.local_task("explore")
@physical
async def explore(task: TaskContext, area: str) -> None:
    """Drive through `area`."""
    await work(task)
