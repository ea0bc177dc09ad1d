"""Looks whether the addresses at which a robot hears others are still those of its machine."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping

from mrbt_mesh.runtime.session_config import AUTO, TransportConfig, own_addresses

_ANY = ("0.0.0.0", "::")


class AddressWatch:
    """Call `look` regularly.

    A session goes on listening when an address goes away, and is reached there again when it is
    back. Neither Zenoh nor a socket reports that.
    """

    def __init__(self, config: TransportConfig) -> None:
        interfaces = own_addresses()
        self._before = _others(interfaces)
        hosts = [_host(endpoint) for endpoint in config.listen]
        scouts = [name.strip() for name in (config.multicast_interface or "").split(",")]
        # A name that is no address of the machine now, as a host's name, cannot go away.
        self._watched = [name for name in (*hosts, *scouts) if _has(interfaces, name)]
        self._is_everywhere = AUTO in scouts or any(host in _ANY for host in hosts)

    def look(self) -> str:
        """What has gone away, for people; empty if nothing has."""
        interfaces = own_addresses()
        gone = [name for name in self._watched if not _has(interfaces, name)]
        if gone:
            here = ", ".join(sorted(_others(interfaces))) or "none but loopback"
            return (
                f"it listens on {', '.join(gone)}, which is not an address of this machine any "
                f"more (now: {here}): give it back, or start the robot with another --listen or "
                "--multicast"
            )
        if self._is_everywhere and self._before and not _others(interfaces):
            return (
                "its machine has lost all addresses but loopback "
                f"(before: {', '.join(sorted(self._before))}): check its interfaces"
            )
        return ""


def _has(interfaces: Mapping[str, list[str]], name: str) -> bool:
    """Whether there is this address, or an interface of this name with one."""
    return bool(interfaces.get(name)) or any(name in each for each in interfaces.values())


def _others(interfaces: Mapping[str, list[str]]) -> set[str]:
    """The addresses at which other machines may reach this one."""
    found = {address for each in interfaces.values() for address in each}
    return {address for address in found if not ipaddress.ip_address(address).is_loopback}


def _host(endpoint: str) -> str:
    """The address in a locator, as in `tcp/10.0.0.7:7450#iface=eth0`."""
    place = endpoint.partition("/")[2].partition("#")[0].partition("?")[0]
    return place.rpartition(":")[0].strip("[]").partition("%")[0]
