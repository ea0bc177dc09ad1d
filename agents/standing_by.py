"""The robots of examples/vehicle_repair/standing_by.yaml: damages come in, and are repaired.

One robot hears when something breaks, diagnosis finds out what, and the robot that has put the last
screws in reports that the vehicle is in order again.
"""

import anyio
from simulated import work

from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram(record_work=True)
POLL_S = 0.1


@robot.local_task
async def do_diagnosis(task: TaskContext, part: str) -> None:
    """Find out whether `part` is broken, and say so together with this task's outcome."""
    await work(task)
    task.set_condition(f"broken({part})", task.read_condition(f"damaged({part})"))


@robot.local_task
async def use_soldering_iron(task: TaskContext, part: str) -> None:
    """The last step of a part's repair."""
    await work(task)
    task.set_condition(f"damaged({part})", False)
    task.set_condition(f"broken({part})", False)


@robot.local_task
async def use_screwdriver(task: TaskContext) -> None:
    """Screws come out at the beginning; when they are in again, the vehicle is in order."""
    await work(task)
    if task.global_task == "place_screws":
        task.set_condition("nominal", True)


@robot.local_task("move_frame")
@robot.local_task("replace_hw")
@robot.local_task("replace_wires")
async def do_work(task: TaskContext, *arguments: str) -> None:
    """Anything that only takes its time."""
    await work(task)


@robot.background
async def sense(context: RobotContext) -> None:
    """The robot at the vehicle: damages come in at their times, and it is in order without any."""
    if context.robot != context.parameters["sensor"]:
        return
    due = list(context.parameters["damages"])
    started = anyio.current_time()
    while True:
        passed_s = (anyio.current_time() - started) * context.simulation.speed
        while due and due[0]["at_s"] <= passed_s:
            for part in due.pop(0)["parts"]:
                context.set_condition(f"damaged({part})", True)
        parts = context.parameters["parts"]
        is_damaged = any(context.read_condition(f"damaged({part})") for part in parts)
        if is_damaged and context.read_condition("nominal"):
            context.set_condition("nominal", False)
        await anyio.sleep(POLL_S)
