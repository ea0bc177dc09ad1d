"""The robots of examples/explore."""

from simulated import work

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)


@robot.local_task
async def explore(task: TaskContext, area: str) -> None:
    """Drive through `area`."""
    await work(task)
