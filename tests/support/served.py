"""The metrics of processes of a test."""

from __future__ import annotations

import contextlib
import random
import socket
from urllib.request import urlopen

from prometheus_client.parser import text_string_to_metric_families as parse

from mrbt_mesh.runtime.launcher import DATAGRAM_PORTS


def free_ports(count: int) -> int:
    """The first of `count` ports in a row that are free now.

    None of those for sockets that dial: one that dials such a port again and again before anybody
    listens there may reach itself.
    """
    while True:
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError):
            port = random.choice(DATAGRAM_PORTS)
            for number in range(count):
                stack.enter_context(socket.socket()).bind(("127.0.0.1", port + number))
            return port


def page(address: str) -> dict[tuple[str, ...], float]:
    """(series, label values...) -> value; empty while nobody answers."""
    with contextlib.suppress(OSError):
        text = urlopen(f"http://{address}/metrics", timeout=10).read().decode()
        return {(s.name, *s.labels.values()): s.value for f in parse(text) for s in f.samples}
    return {}
