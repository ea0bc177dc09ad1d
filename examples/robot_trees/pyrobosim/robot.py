"""What a robot of pyrobosim does for the leaves of its trees; here it only takes time."""

import anyio

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.btcpp import Out

robot = RobotProgram(record_work=True)


@robot.action("Detect")
async def detect(task: TaskContext, found: Out[str], **ports: str) -> None:
    """The coke is on the desk, the second place."""
    await anyio.sleep(1)
    found.set(ports["object"] if "desk0" in task.arguments else "nothing")


@robot.action("Open")
async def open_door(task: TaskContext, target: str) -> None:
    """The team hears of it."""
    await anyio.sleep(1)
    task.set_condition(f"DoorOpen({target})", True)


@robot.action("*")
async def work(kind: str, /, **ports: object) -> None:
    """Everything else takes two seconds."""
    await anyio.sleep(2)
