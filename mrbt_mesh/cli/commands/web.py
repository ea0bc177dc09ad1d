"""`mrbt web`."""

from __future__ import annotations

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.options import JsonOption
from mrbt_mesh.cli.team.options import TeamOptions
from mrbt_mesh.cli.team.page_options import FoxgloveOptions, WebOptions


def web(
    *,
    team: TeamOptions,
    web: WebOptions,
    foxglove: FoxgloveOptions,
    given: Given,
    as_json: JsonOption = False,
) -> None:
    """Show a team in the browser: its tree, robots, timeline, and why; until Ctrl-C.

    The page only watches, unless it is given --control. With --foxglove, Foxglove can follow the
    team as well: open a connection (Foxglove WebSocket) to the address that is told. With --json
    the addresses are the object's `page` and `foxglove`.

    Example: mrbt up MISSION --detach; mrbt web --control; mrbt web --foxglove
    """
    import anyio

    from mrbt_mesh.cli.framework.exits import end_process

    page, foxglove_port = web.page(), foxglove.port(given)
    address = team.find(given)
    from mrbt_mesh.cli.team.page import serve

    end_process(anyio.run(serve, address, page, foxglove_port, as_json))
