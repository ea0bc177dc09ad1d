"""What a Panther does for the leaves of its trees; here it only takes time."""

import anyio

from mrbt_mesh import RobotProgram
from mrbt_mesh.btcpp import Out

robot = RobotProgram(record_work=True)


@robot.action("GetBattery")
async def get_battery(percentage: Out[float]) -> None:
    """Nearly full."""
    percentage.set(0.9)


@robot.action("DockRobot")
async def dock(dock_id: str, dock_type: str, success: Out[bool]) -> None:
    """Drive in."""
    await anyio.sleep(3)
    success.set(True)


@robot.action("*")
async def work(kind: str, /, **ports: object) -> None:
    """Everything else takes two seconds."""
    await anyio.sleep(2)
