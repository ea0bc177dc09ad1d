"""What a robot of pyrobosim does for the leaves of its trees; here it only takes time."""

import anyio

from mrbt_mesh import RobotProgram
from mrbt_mesh.btcpp import Out

robot = RobotProgram(record_work=True)


@robot.condition("DoorOpen")
def door_open(door: str) -> bool:
    """It is closed."""
    return False


@robot.action("Detect")
async def detect(place: str, found: Out[str], **ports: str) -> None:
    """The coke is on the desk, the second place."""
    await anyio.sleep(1)
    found.set(ports["object"] if place == "desk0" else "nothing")


@robot.action("*")
async def work(kind: str, /, **ports: object) -> None:
    """Everything else takes two seconds."""
    await anyio.sleep(2)
