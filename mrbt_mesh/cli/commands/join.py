"""`mrbt join`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import RobotArgument, RunDirOption


def join(
    robot: RobotArgument,
    robot_type: Annotated[
        str | None, option("Its type, if the mission does not list it.", "TYPE", name="--type")
    ] = None,
    takeover: Annotated[bool, option("Replace a live robot of the same id.")] = False,
    run_dir: RunDirOption = None,
) -> None:
    """Start one more robot of the running mission, or a dead one again.

    Example: mrbt join C1
    """
    from mrbt_mesh.cli.team.joining import start_one

    start_one(robot, robot_type, takeover, run_dir)
