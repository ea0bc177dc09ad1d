"""`mrbt abort`."""

from __future__ import annotations

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.team.options import TeamOptions


def abort(team: TeamOptions, given: Given) -> None:
    """End the mission as failed. It cannot be taken back.

    Example: mrbt abort
    """
    from mrbt_mesh.cli.team.orders import tell
    from mrbt_mesh.core.agent.commands import ORDER

    tell(team.find(given), None, ORDER, "abort")
