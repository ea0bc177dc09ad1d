"""Serves the page from within the event loop in which the team is watched."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager

import anyio
import psutil
import uvicorn
from starlette.types import ASGIApp

from mrbt_mesh.errors import InputError
from mrbt_mesh.plugins import ViewerOptions
from mrbt_mesh.views.web.connections import LimitedHttp
from mrbt_mesh.views.web.protection import OwnNames, own_names

LOOPBACK = "127.0.0.1"
ANYWHERE = ("0.0.0.0", "::")
CLOSE_TIMEOUT_S = 1


class PageError(InputError):
    """The page cannot be served; the message has the reason."""


class _Server(uvicorn.Server):
    """A server that leaves signals to the caller, and waits to be ended.

    uvicorn itself polls ten times a second for its end, and for limits that are not set here.
    """

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.must_end = anyio.Event()

    async def main_loop(self) -> None:
        await self.must_end.wait()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


@asynccontextmanager
async def served(
    options: ViewerOptions,
    close: Callable[[], None],
    make_application: Callable[[OwnNames], ASGIApp],
) -> AsyncIterator[str]:
    """Serve an application, made for the names by which it is reached, and yield its address.

    `close` ends its streams. Raises PageError.
    """
    with bound(options) as opened:
        port = opened.getsockname()[1]
        names = {options.host, LOOPBACK, "localhost", *names_of(options.host)}
        config = uvicorn.Config(
            make_application(own_names(names, port, options.public_url)),
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            date_header=False,
            http=LimitedHttp,
            timeout_graceful_shutdown=CLOSE_TIMEOUT_S,
        )
        server, ended = _Server(config), anyio.Event()

        async def serve() -> None:
            await server.serve([opened])
            ended.set()

        async with anyio.create_task_group() as group:
            group.start_soon(serve)
            while not server.started:
                await anyio.sleep(0.01)
            shown = f"[{options.host}]" if ":" in options.host else options.host
            try:
                yield f"http://{shown}:{port}/"
            finally:
                close()
                server.must_end.set()
                with anyio.CancelScope(shield=True), anyio.move_on_after(2 * CLOSE_TIMEOUT_S):
                    await ended.wait()  # the last messages of streams are sent
                group.cancel_scope.cancel()


def names_of(host: str) -> set[str]:
    """The names of this machine, if the page is served on all its addresses."""
    if host not in ANYWHERE:
        return set()
    found = {address.address for each in psutil.net_if_addrs().values() for address in each}
    # Link-local addresses have the name of their link.
    return {name.partition("%")[0].lower() for name in found} | {socket.gethostname().lower()}


def bound(options: ViewerOptions) -> socket.socket:
    """Return a socket at the page's address. Raises PageError."""
    family = socket.AF_INET6 if ":" in options.host else socket.AF_INET
    opened = socket.socket(family, socket.SOCK_STREAM)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((options.host, options.port or 0))
        opened.listen()
    except (OSError, OverflowError) as error:
        opened.close()
        why = getattr(error, "strerror", None) or error
        raise PageError(
            f"nothing can be served at {options.host} port {options.port or 0}: {why}"
        ) from None
    return opened
