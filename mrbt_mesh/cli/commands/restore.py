"""`mrbt restore`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, argument
from mrbt_mesh.cli.options import RobotArgument
from mrbt_mesh.cli.team.options import TeamOptions


def restore(
    robot: RobotArgument,
    team: TeamOptions,
    given: Given,
    local_task: Annotated[
        str, argument("LOCAL_TASK", "What it can do again. Default: all that it has lost.")
    ] = "all",
) -> None:
    """Let a robot do again what it had lost.

    Example: mrbt restore A1 replace_hw
    """
    from mrbt_mesh.cli.team.orders import tell
    from mrbt_mesh.core.agent.commands import RESTORE

    tell(team.find(given), robot, RESTORE, local_task)
