"""`mrbt resume`."""

from __future__ import annotations

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.team.options import TeamOptions


def resume(team: TeamOptions, given: Given) -> None:
    """Go on after `mrbt pause`.

    Example: mrbt resume
    """
    from mrbt_mesh.cli.team.orders import tell
    from mrbt_mesh.core.agent.commands import ORDER

    tell(team.find(given), None, ORDER, "resume")
