"""The description of the API is valid, and has every route."""

from __future__ import annotations

import pytest
from openapi_spec_validator import OpenAPIV31SpecValidator
from starlette.routing import Route

from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.web.access import local_access
from mrbt_mesh.views.web.api import Api
from mrbt_mesh.views.web.feed import Feed
from mrbt_mesh.views.web.openapi import openapi
from tests.support.watched import WELD, watched


@pytest.mark.parametrize("has_tokens", [True, False])
def test_it_is_valid(has_tokens: bool) -> None:
    OpenAPIV31SpecValidator(openapi(has_tokens)).validate()


def test_it_has_every_route_with_its_methods() -> None:
    _, observer = watched(WELD)
    client = TeamClient(type("Watcher", (), {"observer": observer})())
    api = Api(client, Feed(TeamView(observer), lambda: 0), local_access(frozenset()))
    served = {
        (f"/v1{route.path}", method.lower())
        for route in api.application().routes
        if isinstance(route, Route)
        for method in route.methods or ()
        if method != "HEAD"
    }
    paths = openapi(has_tokens=True)["paths"].items()
    described = {(path, name) for path, item in paths for name in item if name != "parameters"}
    assert served == described
