"""The robots of examples/dispense. A dose shows in events.jsonl as soon as it has begun."""

from simulated import work

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)


@robot.local_task("fetch")
@robot.local_task("dose")
@robot.local_task("stir")
@robot.local_task("lift_lid")
async def do_work(task: TaskContext, *arguments: str) -> None:
    """Anything that only takes its time."""
    await work(task)
