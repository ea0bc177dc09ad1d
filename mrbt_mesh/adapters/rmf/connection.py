"""How the websocket of an Open-RMF server is opened: its address, its redirects, its limits."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from websockets.asyncio.client import connect
from websockets.exceptions import InvalidHandshake, InvalidStatus, InvalidURI
from websockets.uri import parse_uri

from mrbt_mesh.errors import InputError

# A request that is longer is refused; a message that is longer than the second one ends the
# connection, since it would have to be in memory as a whole to be skipped.
MAX_REQUEST_BYTES = 1 << 20
MAX_MESSAGE_BYTES = 16 << 20
# The library stops reading from the socket while more frames than this wait to be handled: a frame
# may be as large as a message.
MAX_QUEUE = 1
EXAMPLE = "ws://127.0.0.1:8000/_internal"


class RedirectError(InvalidHandshake):
    """The server sends its clients to an address where no websocket can be."""


class RmfConnection(connect):
    """Opens a connection. Where a redirect leads is the server's fault, and never the user's."""

    def __init__(self, uri: str) -> None:
        super().__init__(uri, proxy=None, max_size=MAX_MESSAGE_BYTES, max_queue=MAX_QUEUE)

    def process_redirect(self, exc: Exception) -> Exception | str:
        """The address that a redirect leads to, or the exception that the attempt ends with."""
        try:
            return super().process_redirect(exc)
        except (InvalidURI, ValueError, LookupError) as error:
            if not isinstance(exc, InvalidStatus):
                raise
            sent = ", ".join(exc.response.headers.get_all("Location"))
            return RedirectError(
                f"the server redirects to {sent!r:.300} (HTTP {exc.response.status_code}): "
                f"{why_wrong(error)}"
            )


def check_uri(option: str, uri: str) -> None:
    """Raises InputError for the value of an option that can be no websocket's URI."""
    try:
        if not uri.startswith(("ws://", "wss://")):
            raise ValueError("")
        if re.search(r"[\s\x00-\x1f\x7f]", uri):
            raise ValueError("it has spaces or control characters")
        parse_uri(uri).host.encode("idna")
        if urlsplit(uri).port == 0:
            raise ValueError("a port is a number from 1 to 65535")
    except (InvalidURI, ValueError) as error:
        why = why_wrong(error)
        text = f"{option} {uri}: a URI is expected, e.g. {EXAMPLE}"
        raise InputError(f"{text}: {why}" if why else text) from None


def why_wrong(error: Exception) -> str:
    """What is wrong with a URI, in few words."""
    return error.msg if isinstance(error, InvalidURI) else str(error)
