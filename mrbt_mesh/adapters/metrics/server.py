"""Serves families to Prometheus over HTTP, as OpenMetrics or in Prometheus' text format.

A separate thread writes the page; its values are read in the event loop, so they do not change
meanwhile. Requests are answered one at a time, and a slow one is cut off, so that they never delay
the robot.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import socket
import socketserver
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from mrbt_mesh.adapters.metrics.families import Distribution, Family, FamilyKind, gauge
from mrbt_mesh.errors import InputError, require
from mrbt_mesh.plugins import MetricsAddress

if TYPE_CHECKING:
    from wsgiref.types import WSGIApplication

    from prometheus_client import CollectorRegistry
    from prometheus_client.core import Metric

LOOP_TIMEOUT_S = 2.0
REQUEST_TIMEOUT_S = 2.0
# Limit for a client that sends or reads slowly; long enough for a page that waits for the loop.
WHOLE_REQUEST_S = LOOP_TIMEOUT_S + REQUEST_TIMEOUT_S
# How often the server checks whether it should stop.
END_LOOK_S = 0.1
RESPONDS = "mrbt_event_loop_responds"

ReadFamilies = Callable[[], list[Family]]


def read_in_loop(loop: asyncio.AbstractEventLoop, read: ReadFamilies) -> list[Family]:
    """Call `read` in the loop, from another thread; add whether the loop answered in time."""
    answer: concurrent.futures.Future[list[Family]] = concurrent.futures.Future()

    def call() -> None:
        try:
            answer.set_result(read())
        except Exception as error:  # raised in the waiting thread
            answer.set_exception(error)

    found: list[Family] = []
    try:
        loop.call_soon_threadsafe(call)
        found = answer.result(LOOP_TIMEOUT_S)
        responds = True
    except (TimeoutError, RuntimeError):  # the loop hangs, or has ended
        responds = False
    text = f"Whether the event loop answered within {LOOP_TIMEOUT_S:g} s."
    return [gauge(RESPONDS, text, float(responds)), *found]


def metrics_app(read: ReadFamilies) -> WSGIApplication:
    """Return a WSGI application for Prometheus. Raises InputError if the library is missing."""
    registry = _registry(read)
    from prometheus_client import make_wsgi_app

    return make_wsgi_app(registry)


def written(read: ReadFamilies, accept: str) -> tuple[bytes, str]:
    """Return the page for this `Accept` header, and its content type.

    Raises InputError if the library is missing.
    """
    registry = _registry(read)
    from prometheus_client.exposition import choose_encoder

    encode, content_type = choose_encoder(accept)
    return encode(registry), content_type


def require_library() -> None:
    """Raise InputError if the library is missing."""
    require("Prometheus", "metrics", "prometheus_client")


def _registry(read: ReadFamilies) -> CollectorRegistry:
    require_library()
    from prometheus_client import CollectorRegistry

    class Collector:
        def describe(self) -> Iterable[Metric]:
            return ()  # otherwise the registry would collect once when it registers this

        def collect(self) -> Iterator[Metric]:
            return map(_metric, read())

    registry = CollectorRegistry()
    registry.register(Collector())
    return registry


def _metric(family: Family) -> Metric:
    from prometheus_client import core

    name, text, labels = family.name, family.help, list(family.labels)
    if family.kind is FamilyKind.HISTOGRAM:
        histogram = core.HistogramMetricFamily(name, text, labels=labels)
        for values, value in family.samples:
            assert isinstance(value, Distribution)
            histogram.add_metric(list(values), value.buckets(), value.sum_s)
        return histogram
    if family.kind is FamilyKind.INFO:
        info = core.InfoMetricFamily(name, text)
        for values, _ in family.samples:
            info.add_metric([], dict(zip(labels, values, strict=True)))
        return info
    make: Any = core.CounterMetricFamily
    if family.kind is FamilyKind.GAUGE:
        make = core.GaugeMetricFamily
    found: Metric = make(name, text, labels=labels)
    for values, value in family.samples:
        found.add_metric(list(values), value)  # type: ignore[attr-defined]
    return found


class _Handler(WSGIRequestHandler):
    timeout = REQUEST_TIMEOUT_S

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        pass


class _Server(WSGIServer):
    def server_bind(self) -> None:
        # As in the base class, but without a DNS look-up of the host's name.
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), self.server_address[1]
        self.setup_environ()

    def finish_request(self, request: Any, client_address: Any) -> None:
        timer = threading.Timer(WHOLE_REQUEST_S, _cut_off, (request,))
        timer.daemon = True
        timer.start()
        try:
            super().finish_request(request, client_address)
        finally:
            timer.cancel()

    def handle_error(self, request: Any, client_address: Any) -> None:
        pass  # the client has disconnected or was cut off


def _cut_off(connection: socket.socket) -> None:
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)


@contextmanager
def serving(address: MetricsAddress, app: WSGIApplication) -> Iterator[int]:
    """Serve a page while the block runs; yields the port. Raises InputError if it cannot listen."""
    try:
        server = _Server((address.host, address.port), _Handler)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"metrics cannot be served on {address}: {reason}") from None
    server.set_app(app)
    thread = threading.Thread(
        target=server.serve_forever, args=(END_LOOK_S,), name="metrics", daemon=True
    )
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
