"""`mrbt pause`."""

from __future__ import annotations

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.team.options import TeamOptions


def pause(team: TeamOptions, given: Given) -> None:
    """Stop all work until `mrbt resume`.

    Example: mrbt pause
    """
    from mrbt_mesh.cli.team.orders import tell
    from mrbt_mesh.core.agent.commands import ORDER

    tell(team.find(given), None, ORDER, "pause")
