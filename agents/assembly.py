"""The robots of examples/assembly: the leaves of the tree that is their local task."""

import anyio
from simulated import held

from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram(record_work=True)

# Which robots hold their tool, and from which it has slipped; a real one would ask its gripper.
# Simulated ones share this module.
holding: set[tuple[str, int]] = set()
slipped: set[tuple[str, int]] = set()


@robot.background
async def set_out(context: RobotContext) -> None:
    """A robot that starts, or starts again, holds nothing."""
    me = context.robot, context.simulation.pid
    holding.discard(me)
    slipped.discard(me)


@robot.condition("Holding")
def holds(context: RobotContext) -> bool:
    """Whether it has the tool in its gripper."""
    return (context.robot, context.simulation.pid) in holding


@robot.action("Grasp")
async def grasp(task: TaskContext) -> None:
    """Take the tool up."""
    await held(task)
    await anyio.sleep(1 / task.simulation.speed)
    holding.add((task.robot, task.simulation.pid))


@robot.action("Turn")
async def turn(task: TaskContext, part: str) -> None:
    """Turn the screw; at part 2 the tool slips, once per robot."""
    await held(task)
    me = task.robot, task.simulation.pid
    if part == "2" and me not in slipped:
        slipped.add(me)
        # The tree reads it in its next tick, has this action halted, and the tool taken up again.
        holding.discard(me)
    await anyio.sleep(2 / task.simulation.speed)
