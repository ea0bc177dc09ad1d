"""The robots of examples/lift: whatever one of them does takes its time, and changes what its
local task declares in team.yaml.
"""

from simulated import physical, work

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram()


@robot.local_task("remove_screws")
@physical
async def remove_screws(task: TaskContext) -> None:
    await work(task)
    task.set_condition("screwed", False)


@robot.local_task("remove_cover")
@physical
async def remove_cover(task: TaskContext) -> None:
    await work(task)
    task.set_condition("covered", False)


@robot.local_task("diagnose")
@physical
async def diagnose(task: TaskContext, part: str) -> None:
    await work(task)
    task.set_condition(f"diagnosed({part})", True)


@robot.local_task("replace_hw")
@robot.local_task("replace_wires")
@robot.local_task("solder")
@physical
async def repair(task: TaskContext, part: str) -> None:
    await work(task)


@robot.local_task("place_cover")
@physical
async def place_cover(task: TaskContext) -> None:
    await work(task)
    task.set_condition("covered", True)


@robot.local_task("place_screws")
@physical
async def place_screws(task: TaskContext) -> None:
    await work(task)
    task.set_condition("screwed", True)
