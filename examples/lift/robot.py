"""What a mechanic does for the leaves of repair.xml; here it only takes time."""

import anyio

from mrbt_mesh import RobotProgram

robot = RobotProgram(record_work=True)

SECONDS = {"diagnose": 2, "solder": 2, "remove_cover": 2, "place_cover": 2}


@robot.action("*")
async def work(kind: str, /, **ports: object) -> None:
    """Everything else takes three seconds."""
    await anyio.sleep(SECONDS.get(kind, 3))
