"""What a robot says when an address at which it hears others goes away."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from types import SimpleNamespace
from unittest import mock

import psutil
import pytest

from mrbt_mesh.runtime.address_watch import AddressWatch
from mrbt_mesh.runtime.session_config import TransportConfig

HERE = {"lo": ["127.0.0.1", "::1"], "eth0": ["10.0.0.7", "fe80::1%eth0"], "eth1": ["10.1.0.7"]}


class Machine:
    """The addresses of a machine, which a test takes away."""

    def __init__(self) -> None:
        self.interfaces = {name: list(addresses) for name, addresses in HERE.items()}

    def rows(self) -> dict[str, list[SimpleNamespace]]:
        def family(address: str) -> int:
            return socket.AF_INET6 if ":" in address else socket.AF_INET

        return {
            name: [SimpleNamespace(family=family(each), address=each) for each in addresses]
            for name, addresses in self.interfaces.items()
        }


@pytest.fixture
def machine() -> Iterator[Machine]:
    made = Machine()
    with mock.patch.object(psutil, "net_if_addrs", made.rows):
        yield made


@pytest.mark.parametrize(
    ("config", "shown"),
    [
        ({"listen": ("tcp/10.0.0.7:7450",)}, "10.0.0.7"),
        ({"listen": ("tcp/10.1.0.7:1", "tcp/10.0.0.7:7450#iface=eth0")}, "10.0.0.7"),
        ({"listen": ("tcp/[fe80::1%eth0]:7450",)}, "fe80::1"),
        ({"multicast_interface": "eth0"}, "eth0"),
        ({"multicast_interface": "eth1, 10.0.0.7"}, "10.0.0.7"),
        ({"listen": ("tcp/10.0.0.7:1",), "multicast_interface": "eth0"}, "10.0.0.7, eth0"),
    ],
)
@pytest.mark.parametrize("goes", ["addresses", "interface"])
def test_an_address_that_goes_away_and_comes_back(
    machine: Machine, config: dict[str, object], shown: str, goes: str
) -> None:
    watch = AddressWatch(TransportConfig("t", "A", **config))  # type: ignore[arg-type]
    assert watch.look() == ""
    before = machine.interfaces.pop("eth0")
    if goes == "addresses":
        machine.interfaces["eth0"] = []
    assert watch.look().startswith(
        f"it listens on {shown}, which is not an address of this machine"
    )
    assert "(now: 10.1.0.7): give it back, or start the robot with another --list" in watch.look()
    machine.interfaces["eth0"] = before
    assert watch.look() == ""


@pytest.mark.parametrize(
    "config",
    [{"multicast_interface": "auto"}, {"listen": ("tcp/0.0.0.0:1",)}, {"listen": ("tcp/[::]:1",)}],
)
def test_who_listens_everywhere_needs_any_address(
    machine: Machine, config: dict[str, object]
) -> None:
    watch = AddressWatch(TransportConfig("t", "A", **config))  # type: ignore[arg-type]
    del machine.interfaces["eth0"]
    assert watch.look() == ""
    del machine.interfaces["eth1"]
    assert watch.look().startswith("its machine has lost all addresses but loopback (before: 10.0.")
    machine.interfaces["wlan0"] = ["10.2.0.7"]
    assert watch.look() == ""


def test_what_was_no_address_cannot_go_away(machine: Machine) -> None:
    """A host's name; a machine that had loopback alone; a robot that listens nowhere."""
    machine.interfaces = {"lo": ["127.0.0.1"]}
    for config in (
        TransportConfig("t", "A", listen=("tcp/robot.local:1",)),
        TransportConfig("t", "A", multicast_interface="auto"),
        TransportConfig("t", "A", connect=("tcp/10.0.0.9:1",)),
    ):
        assert AddressWatch(config).look() == ""
