"""`mrbt serve`: a team over HTTP, and for Open-RMF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrbt_mesh.cli.command import PATH, PORT, SUCCESS, MrbtCommand
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.cli.team_options import TeamOptions, team_options
from mrbt_mesh.errors import InputError
from mrbt_mesh.plugins import ViewerOptions, require

if TYPE_CHECKING:
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
@click.option("--rmf", metavar="URI", help="Also be a fleet of this Open-RMF server: ws://...")
@team_options
@json_option
def serve(
    host: str, port: int, tokens: Path | None, rmf: str | None, team: TeamOptions, as_json: bool
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
        if not rmf.startswith(("ws://", "wss://")):
            raise InputError(f"--rmf {rmf}: a URI is expected, e.g. ws://127.0.0.1:8000/_internal")
    import anyio

    from mrbt_mesh.views.web.access import is_loopback, token_access

    if tokens is None and not is_loopback(host):
        raise InputError(
            f"--host {host}: others reach this address, so give their tokens with --tokens FILE"
        )
    access = token_access(tokens) if tokens is not None else None
    address, options = team.find_running(), ViewerOptions(host, port)
    anyio.run(_serve, address, options, access, rmf, as_json)
    raise SystemExit(SUCCESS)


async def _serve(
    address: TeamAddress,
    options: ViewerOptions,
    access: Access | None,
    rmf: str | None,
    as_json: bool,
) -> None:
    import anyio
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.responses import JSONResponse
    from starlette.routing import Mount, Route
    from starlette.types import ASGIApp

    from mrbt_mesh.cli.watching import served_until_interrupted
    from mrbt_mesh.runtime.fencing import boottime_us
    from mrbt_mesh.runtime.team_client import CONNECT_TIMEOUT_S, TeamClient
    from mrbt_mesh.runtime.watcher import watching
    from mrbt_mesh.views.model.team_view import TeamView
    from mrbt_mesh.views.web.access import local_access
    from mrbt_mesh.views.web.api import Api
    from mrbt_mesh.views.web.feed import Feed
    from mrbt_mesh.views.web.openapi import openapi
    from mrbt_mesh.views.web.problem import PROBLEMS
    from mrbt_mesh.views.web.protection import Protection
    from mrbt_mesh.views.web.server import served

    async with watching(address) as watcher, anyio.create_task_group() as group:
        await watcher.catch_up(CONNECT_TIMEOUT_S)
        client, feed = TeamClient(watcher), Feed(TeamView(watcher.observer), boottime_us)
        group.start_soon(client.follow, feed.update)
        if rmf is not None:
            from mrbt_mesh.adapters.rmf.link import RmfLink

            group.start_soon(RmfLink(client, feed.view.changes, rmf).run)
        described = JSONResponse(openapi(has_tokens=access is not None))

        def application(own_hosts: frozenset[str]) -> ASGIApp:
            api = Api(client, feed, access or local_access(own_hosts))
            routes = [Mount("/v1", api.application()), Route("/openapi.json", described)]
            protection = Middleware(
                Protection,
                own_hosts=own_hosts if access is None else None,
                content_policy="default-src 'none'",
            )
            return Starlette(
                routes=routes,
                middleware=[protection],
                exception_handlers=PROBLEMS,
            )

        async with served(options, feed.close, application) as where:
            await served_until_interrupted("serve", where, as_json)
        group.cancel_scope.cancel()
