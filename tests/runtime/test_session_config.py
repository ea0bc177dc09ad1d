"""What is checked before a session is opened."""

from __future__ import annotations

import errno
import json
import socket
import threading
from types import SimpleNamespace
from unittest import mock

import psutil
import pytest

from mrbt_mesh.runtime.session_config import (
    TransportConfig,
    TransportError,
    require_threads,
    session_config,
)

V4, V6, LINK = socket.AF_INET, socket.AF_INET6, psutil.AF_LINK
INTERFACES = {
    "lo": [(V4, "127.0.0.1")],
    "eth0": [(V4, "10.0.0.7"), (V6, "fe80::1%eth0"), (LINK, "02:00:00:00:00:01")],
    "wlan0": [(LINK, "02:00:00:00:00:02")],
}


@pytest.fixture(autouse=True)
def interfaces() -> object:
    rows = {
        name: [SimpleNamespace(family=family, address=address) for family, address in row]
        for name, row in INTERFACES.items()
    }
    with mock.patch.object(psutil, "net_if_addrs", return_value=rows) as patched:
        yield patched


@pytest.mark.parametrize("name", ["auto", "lo", "eth0", "10.0.0.7", "fe80::1", "lo,eth0"])
def test_interfaces_that_are_there(name: str) -> None:
    TransportConfig("t", "A", multicast_interface=name)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        (
            "eth9",
            r"--multicast 'eth9': this machine has no such interface or address \(eth0, lo, wl",
        ),
        ("10.0.0.8", "no such interface"),
        ("02:00:00:00:00:01", "no such interface"),
        ("lo,eth9", "--multicast 'eth9'"),
        ("wlan0", "--multicast wlan0: this interface has no address"),
        ("", "no such interface"),
    ],
)
def test_interfaces_that_are_not(name: str, reason: str) -> None:
    with pytest.raises(TransportError, match=reason):
        TransportConfig("t", "A", multicast_interface=name)


@pytest.fixture
def no_ipv6(monkeypatch: pytest.MonkeyPatch) -> None:
    real = socket.socket

    def opened(family: int = V4, *more: int) -> socket.socket:
        if family == V6:
            raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")
        return real(family, *more)

    monkeypatch.setattr(socket, "socket", opened)


@pytest.mark.usefixtures("no_ipv6")
@pytest.mark.parametrize("listen", [(), ("tcp/[::]:7450",), ("tcp/[::]:7450", "tcp/10.0.0.7:1")])
def test_a_machine_without_ipv6_listens_on_all_addresses_that_it_has(
    listen: tuple[str, ...],
) -> None:
    config = TransportConfig("t", "A", listen, multicast_interface=None if listen else "auto")
    found = json.loads(session_config(config).get_json("listen/endpoints"))
    assert found == [each.replace("[::]", "0.0.0.0") for each in listen or ("tcp/[::]:0",)]
    assert config.where().endswith("this machine has no IPv6")


@pytest.mark.usefixtures("no_ipv6")
def test_it_is_not_said_where_it_changes_nothing() -> None:
    assert "IPv6" not in TransportConfig("t", "A", ("tcp/10.0.0.7:1",)).where()


def test_where_a_robot_hears_others() -> None:
    assert TransportConfig("t", "A", multicast_interface="auto").where() == (
        "multicast of auto (eth0, wlan0)"
    )
    ends = TransportConfig("t", "A", ("tcp/10.0.0.7:1",), ("tcp/10.0.0.8:1",))
    assert ends.where() == "listening on tcp/10.0.0.7:1; dialling tcp/10.0.0.8:1"
    assert TransportConfig("t", "A", routers=("tcp/a:1",)).where() == "router tcp/a:1"


def test_a_session_needs_threads_and_says_so_before_it_is_opened() -> None:
    require_threads()
    started: list[threading.Thread] = []

    def start(thread: threading.Thread) -> None:
        if len(started) == 8:
            raise RuntimeError("can't start new thread")
        started.append(thread)
        original(thread)

    original = threading.Thread.start
    with (
        mock.patch.object(threading.Thread, "start", start),
        pytest.raises(TransportError, match=r"only 8 of 32 threads .* \(ulimit -u, pids\.max"),
    ):
        require_threads()
    assert not any(thread.is_alive() for thread in started)
