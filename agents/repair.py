"""The robots of examples/vehicle_repair: diagnosis finds out what is broken, the rest is work."""

from simulated import physical, work

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram()


@robot.local_task("do_diagnosis")
@physical
async def do_diagnosis(task: TaskContext, part: str) -> None:
    """Find out whether `part` is broken, and say so together with this task's outcome."""
    await work(task)
    broken_parts = {str(broken) for broken in task.parameters.get("broken_parts", [])}
    task.set_condition(f"broken({part})", part in broken_parts)


@robot.local_task("use_screwdriver")
@robot.local_task("move_frame")
@robot.local_task("replace_hw")
@robot.local_task("replace_wires")
@robot.local_task("use_soldering_iron")
@physical
async def do_work(task: TaskContext, *arguments: str) -> None:
    """Anything that only takes its time."""
    await work(task)
