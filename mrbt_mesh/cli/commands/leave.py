"""`mrbt leave`."""

from __future__ import annotations

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.options import RobotArgument
from mrbt_mesh.cli.team.options import TeamOptions


def leave(robot: RobotArgument, team: TeamOptions, given: Given) -> None:
    """Have a robot leave on purpose: its work is handed over at once.

    Example: mrbt leave B1
    """
    from mrbt_mesh.cli.team.orders import tell
    from mrbt_mesh.core.agent.commands import LEAVE

    tell(team.find(given), robot, LEAVE)
