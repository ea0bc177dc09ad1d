"""What a drone with Aerostack2 does for the leaves of its trees; here it only takes time."""

import anyio

from mrbt_mesh import RobotProgram
from mrbt_mesh.btcpp import Out

robot = RobotProgram(record_work=True)


@robot.action("WaitForEvent")
async def wait_for_event(topic_name: str, result: Out[str]) -> None:
    """The signal comes at once."""
    result.set(topic_name)


@robot.action("GetGatePose")
async def get_gate_pose(gate: str, pose: Out[str]) -> None:
    """Where the gate is."""
    pose.set(f"gate {gate}")


@robot.action("*")
async def work(kind: str, /, **ports: object) -> None:
    """Everything else takes two seconds."""
    await anyio.sleep(2)
