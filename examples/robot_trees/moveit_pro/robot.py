"""What an arm with MoveIt Pro does for the leaves of its objectives; here it only takes time."""

import anyio

from mrbt_mesh import RobotProgram
from mrbt_mesh.btcpp import Out

robot = RobotProgram(record_work=True)


@robot.action("TakeSnapshot")
async def take_snapshot(point_cloud: Out[str]) -> None:
    """Look."""
    await anyio.sleep(0.5)
    point_cloud.set("points")


@robot.action("GetMasks")
async def get_masks(prompt: str, point_cloud: str, masks: Out[str]) -> None:
    """Find objects of this kind."""
    masks.set(f"{prompt} in {point_cloud}")


@robot.action("InitializeMTCTask")
async def initialize_task(task: Out[str]) -> None:
    """Begin a plan."""
    task.set("stages")


@robot.action("PlanMTCTask")
async def plan_task(task: str, solution: Out[str]) -> None:
    """Make the plan."""
    await anyio.sleep(1)
    solution.set(f"trajectory of {task}")


@robot.action("LoadPointCloudFromFile")
async def load_points(file: str, point_cloud: Out[str]) -> None:
    """Read the part's shape."""
    point_cloud.set(file)


@robot.action("GetTrajectoryOverSurface")
async def get_trajectory(point_cloud: str, trajectory: Out[str]) -> None:
    """A path over the surface."""
    trajectory.set(f"over {point_cloud}")


@robot.action("*")
async def work(kind: str, /, **ports: object) -> None:
    """Everything else takes two seconds."""
    await anyio.sleep(2)
