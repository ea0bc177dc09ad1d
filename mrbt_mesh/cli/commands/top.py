"""`mrbt top`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.team.options import TeamOptions


def top(
    team: TeamOptions,
    given: Given,
    control: Annotated[
        bool, option("Keys also kill, freeze, thaw, pause, resume and abort; each asks.")
    ] = False,
) -> None:
    """Show a team in this terminal, by keys: its tree, robots, timeline, and why; q ends it.

    It only watches, unless it is given --control. ? lists the keys.

    Example: mrbt up MISSION --detach; mrbt top --control
    """
    import anyio

    from mrbt_mesh.cli.framework.exits import end_process
    from mrbt_mesh.cli.team import terminal_options

    terminal_options.check()
    address = team.find(given)
    from mrbt_mesh.cli.team.terminal import show

    end_process(anyio.run(show, address, control))
