"""Opens the websocket of an Open-RMF server: address, redirects, limits."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from websockets.asyncio.client import connect
from websockets.exceptions import InvalidHandshake, InvalidStatus, InvalidURI
from websockets.uri import parse_uri

from mrbt_mesh.errors import InputError

# A longer request is refused. A message longer than MAX_MESSAGE_BYTES ends the connection, since
# it would have to be read into memory completely to be skipped.
MAX_REQUEST_BYTES = 1 << 20
MAX_MESSAGE_BYTES = 16 << 20
# The library stops reading from the socket while more frames than this are waiting; a frame may be
# as large as a message.
MAX_QUEUE = 1
EXAMPLE = "ws://127.0.0.1:8000/_internal"


class RedirectError(InvalidHandshake):
    """The server redirects to an address that cannot be a websocket's."""


class RmfConnection(connect):
    """Opens a connection. A bad redirect is reported as the server's error, not the user's."""

    def __init__(self, uri: str) -> None:
        super().__init__(uri, proxy=None, max_size=MAX_MESSAGE_BYTES, max_queue=MAX_QUEUE)

    def process_redirect(self, exc: Exception) -> Exception | str:
        """Return the address of a redirect, or the exception that ends the attempt."""
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
    """Raise InputError if the value of an option cannot be a websocket's URI."""
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
    """Return a short text of what is wrong with a URI."""
    return error.msg if isinstance(error, InvalidURI) else str(error)
