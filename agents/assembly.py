"""The robots of examples/assembly: the actions of the tree that is their local task."""

from simulated import held, work

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)


@robot.local_task
async def grasp(task: TaskContext) -> None:
    """Take the tool up."""
    await work(task)
    task.set_local_condition("holding", True)


@robot.local_task
async def turn(task: TaskContext, part: str) -> None:
    """Turn the screw; at part 2 the tool slips, once per robot."""
    await held(task)
    if part == "2" and not task.read_local_condition("slipped"):
        task.set_local_condition("slipped", True, at_once=True)
        # Now the tree has this action cancelled, and the tool taken up again.
        task.set_local_condition("holding", False, at_once=True)
    await work(task)
