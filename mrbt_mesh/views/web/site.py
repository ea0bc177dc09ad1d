"""The site of `mrbt serve`: the API below `/v1`, its description, and a page that lists it."""

from __future__ import annotations

from html import escape
from typing import Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route

from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.views.web.access import Access, local_access
from mrbt_mesh.views.web.api import Api
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.openapi import openapi
from mrbt_mesh.views.web.problem import PROBLEMS
from mrbt_mesh.views.web.protection import OwnNames, Protection


def site(
    client: TeamClient,
    feed: Feed,
    own: OwnNames,
    access: Access | None = None,
    public_url: str = "",
) -> Starlette:
    """Return the ASGI application. `access` None admits the programs of this machine."""
    api = Api(client, feed, access or local_access(own), own.prefix)

    async def described(_: Request) -> Response:
        """Describe the API with the current job types."""
        mission = client.watcher.observer.mission
        return JSONResponse(openapi(access is not None, public_url, mission))

    page = HTMLResponse(documentation(openapi(access is not None)))
    routes = [
        Route("/", page),
        Route("/docs", page),
        Route("/openapi.json", described),
        Route("/v1", page),
        Mount("/v1", api.application()),
    ]
    # With tokens any host name is accepted: no page of another site has a token.
    protection = Middleware(
        Protection, own=own if access is None else None, content_policy="default-src 'none'"
    )
    made = Starlette(routes=routes, middleware=[protection], exception_handlers=PROBLEMS)
    made.router.redirect_slashes = False  # it would lead past a proxy
    return made


def documentation(document: dict[str, Any]) -> str:
    """Return a self-contained page that lists the operations of an OpenAPI description."""
    rows = "\n".join(
        f"<tr><td><code>{method.upper()} {escape(path)}</code><td>{escape(operation['summary'])}"
        for path, item in document["paths"].items()
        for method, operation in item.items()
        if method != "parameters"
    )
    title = f"{document['info']['title']} {document['info']['version']}: HTTP API"
    return (
        f'<!DOCTYPE html>\n<html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>\n'
        f"<h1>{escape(title)}</h1>\n<p>All fields, answers and errors: "
        f'<a href="openapi.json">openapi.json</a> (OpenAPI {document["openapi"]}).</p>\n'
        f"<table>\n{rows}\n</table>\n</html>\n"
    )
