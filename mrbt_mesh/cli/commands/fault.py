"""`mrbt fault`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import RobotArgument
from mrbt_mesh.cli.team.options import TeamOptions


def fault(
    robot: RobotArgument,
    lose: Annotated[
        str, option("Local task that the robot can no longer do, or `all`.", "LOCAL_TASK")
    ],
    team: TeamOptions,
    given: Given,
) -> None:
    """Take a capability from a robot: a minor fault.

    Example: mrbt fault A1 --lose replace_hw
    """
    from mrbt_mesh.cli.team.orders import tell
    from mrbt_mesh.core.agent.commands import FAULT

    tell(team.find(given), robot, FAULT, lose)
