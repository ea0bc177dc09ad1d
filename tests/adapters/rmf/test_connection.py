"""The address of an Open-RMF server: wrong ones are the user's fault, wrong redirects are not."""

from __future__ import annotations

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidHandshake, InvalidStatus
from websockets.http11 import Response
from websockets.uri import parse_uri

from mrbt_mesh.adapters.rmf.connection import RmfConnection, check_uri
from mrbt_mesh.errors import InputError

URI = "ws://127.0.0.1:8000/_internal"


@pytest.mark.parametrize(
    "uri",
    [
        "http://x",
        "ws://",
        "ws://127.0.0.1:99999/",
        "ws://127.0.0.1:0/",
        "ws://127.0.0.1:abc/x",
        "ws://[::1/x",
        "ws://[zz]/",
        "ws://host#part",
        "ws://user@host/",
        "ws://a b/",
        "ws://host/\n",
        "ws://host/\udc80",
        f"ws://{'a' * 70}/",
    ],
)
def test_a_wrong_uri_is_refused_with_an_example(uri: str) -> None:
    with pytest.raises(InputError, match="a URI is expected") as refused:
        check_uri("--rmf", uri)
    assert str(refused.value).startswith(f"--rmf {uri}: ")


@pytest.mark.parametrize("uri", [URI, "wss://rmf.example/x", "ws://[::1]:7/", "ws://depot:80/ä"])
def test_other_uris_are_taken(uri: str) -> None:
    check_uri("--rmf", uri)


def redirected(*locations: str) -> Exception | str:
    headers = Headers([("Location", location) for location in locations])
    connection = RmfConnection(URI)
    connection.ws_uri = parse_uri(URI)  # as it is while the server answers
    return connection.process_redirect(InvalidStatus(Response(301, "Moved", headers)))


@pytest.mark.parametrize(
    "locations",
    [
        ["https://rmf.example/_internal"],
        ["http://127.0.0.1/"],
        ["ws://127.0.0.1:99999/"],
        ["ws://[::1/"],
        ["ws://a/", "ws://b/"],
    ],
)
def test_a_redirect_that_leads_nowhere_names_where_it_leads(locations: list[str]) -> None:
    error = redirected(*locations)
    assert isinstance(error, InvalidHandshake), "as others that are tried again"
    for location in locations:
        assert location in str(error)
    assert "HTTP 301" in str(error)


def test_a_redirect_to_a_websocket_is_followed() -> None:
    assert redirected("/other") == "ws://127.0.0.1:8000/other"
