"""What a robot with Nav2 does for the leaves of its trees; here it only takes time."""

import anyio

from mrbt_mesh import RobotProgram
from mrbt_mesh.btcpp import Out

robot = RobotProgram(record_work=True)
robot.condition("GoalUpdated")(lambda: False)
robot.entry("goal")(lambda: "4.0;0.5;0.0")


@robot.action("ComputePathToPose")
async def compute_path_to_pose(goal: str, planner_id: str, path: Out[str]) -> None:
    """Ask the planner."""
    await anyio.sleep(0.2)
    path.set(f"0;0;0 {goal}")


@robot.action("*")
async def work(kind: str, /, **ports: object) -> None:
    """Everything else takes two seconds."""
    await anyio.sleep(2)
