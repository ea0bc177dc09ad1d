"""`mrbt serve`: serves a team over HTTP, and to Open-RMF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrbt_mesh.cli.command import PATH, PORT, SUCCESS, MrbtCommand, refuse
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.cli.plugged import public_url_option
from mrbt_mesh.cli.team_options import TeamOptions, team_options
from mrbt_mesh.errors import InputError, require
from mrbt_mesh.plugins import ViewerOptions

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from mrbt_mesh.runtime.team_address import TeamAddress
    from mrbt_mesh.views.web.access import Access


@click.command(cls=MrbtCommand)
@click.option("--host", default="127.0.0.1", metavar="IP", help="Address to serve it at.")
@click.option("--port", type=PORT, metavar="PORT", default=0, help="Port; 0: any.")
@click.option(
    "--tokens",
    type=PATH,
    metavar="FILE",
    help="Who may read and who may submit. Needed unless it is served to this machine alone.",
)
@public_url_option("API")
@click.option("--rmf", metavar="URI", help="Also be a fleet of this Open-RMF server: ws://...")
@click.option("--rmf-fleet", metavar="NAME", help="Name of the fleet. Default: the mission's.")
@team_options
@json_option
def serve(
    host: str,
    port: int,
    tokens: Path | None,
    public_url: str | None,
    rmf: str | None,
    rmf_fleet: str | None,
    team: TeamOptions,
    as_json: bool,
) -> None:
    """Serve a team's state and its jobs over HTTP.

    It runs until Ctrl-C. Any machine that reaches the team may serve it, and several at once: jobs
    are kept by the robots. The description of the API is at /openapi.json.

    \b
    Example: mrbt serve --port 8080
             curl -X POST http://127.0.0.1:8080/v1/jobs -H "content-type: application/json" \\
                  -d '{"type": "inspect", "arguments": {"where": "shelf_5"}}'
    """
    require("mrbt serve", "web", "starlette", "uvicorn")
    if rmf is not None:
        require("--rmf", "rmf", "websockets")
        from mrbt_mesh.adapters.rmf.connection import check_uri

        check_uri("--rmf", rmf)
    else:
        refuse("of an Open-RMF server: give --rmf as well", "--rmf-fleet")
    import anyio

    from mrbt_mesh.views.web.access import is_loopback, token_access

    if tokens is None and not is_loopback(host):
        raise InputError(
            f"--host {host}: others reach this address, so give their tokens with --tokens FILE"
        )
    access = token_access(tokens) if tokens is not None else None
    address, options = team.find_running(), ViewerOptions(host, port, public_url=public_url or "")
    anyio.run(_serve, address, options, access, rmf, rmf_fleet or "", as_json)
    raise SystemExit(SUCCESS)


async def _serve(
    address: TeamAddress,
    options: ViewerOptions,
    access: Access | None,
    rmf: str | None,
    rmf_fleet: str,
    as_json: bool,
) -> None:
    import anyio

    from mrbt_mesh.cli.watching import served_until_interrupted
    from mrbt_mesh.runtime.fencing import boottime_us
    from mrbt_mesh.runtime.team_client import CONNECT_TIMEOUT_S, TeamClient
    from mrbt_mesh.runtime.watcher import watching
    from mrbt_mesh.views.model.team_view import TeamView
    from mrbt_mesh.views.web.feed import Feed
    from mrbt_mesh.views.web.protection import OwnNames
    from mrbt_mesh.views.web.server import served
    from mrbt_mesh.views.web.site import site

    async with watching(address) as watcher, anyio.create_task_group() as group:
        await watcher.catch_up(CONNECT_TIMEOUT_S)
        client, feed = TeamClient(watcher), Feed(TeamView(watcher.observer), boottime_us)
        group.start_soon(client.follow, feed.update)
        if rmf is not None:
            from mrbt_mesh.adapters.rmf.link import RmfLink

            group.start_soon(RmfLink(client, feed.view.changes, rmf, rmf_fleet).run)

        def application(own: OwnNames) -> Starlette:
            return site(client, feed, own, access, options.public_url)

        async with served(options, feed.close, application) as where:
            await served_until_interrupted("serve", where, as_json, options.public_url)
        group.cancel_scope.cancel()
