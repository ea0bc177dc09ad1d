"""`mrbt web`."""

from __future__ import annotations

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.options import JsonOption
from mrbt_mesh.cli.team.options import TeamOptions
from mrbt_mesh.cli.team.page_options import WebOptions


def web(team: TeamOptions, web: WebOptions, given: Given, as_json: JsonOption = False) -> None:
    """Show a team in the browser: its tree, robots, timeline, and why; until Ctrl-C.

    The page only watches, unless it is given --control. With --json its address is the object's
    `page`.

    Example: mrbt up MISSION --detach; mrbt web --control
    """
    import anyio

    from mrbt_mesh.cli.framework.exits import end_process

    page = web.page()
    address = team.find(given)
    from mrbt_mesh.cli.team.page import serve

    end_process(anyio.run(serve, address, page, as_json))
