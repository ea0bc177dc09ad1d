"""Checks whether the addresses at which a robot listens still belong to its machine."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping

from mrbt_mesh.runtime.session_config import AUTO, TransportConfig, own_addresses

_ANY = ("0.0.0.0", "::")


class AddressWatch:
    """Detects lost addresses. Call `look` regularly.

    A session continues to listen when an address goes away, and is reached there again when the
    address is back. Neither Zenoh nor a socket reports that.
    """

    def __init__(self, config: TransportConfig) -> None:
        interfaces = own_addresses()
        self._before = _others(interfaces)
        hosts = [_host(endpoint) for endpoint in config.listen]
        scouts = [name.strip() for name in (config.multicast_interface or "").split(",")]
        # A name that is not an address of the machine now, such as a host name, cannot go away.
        self._watched = [name for name in (*hosts, *scouts) if _has(interfaces, name)]
        self._is_everywhere = AUTO in scouts or any(host in _ANY for host in hosts)

    def look(self) -> str:
        """Return a message about lost addresses; empty if there are none."""
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
    """Return whether this address exists, or an interface of this name with an address."""
    return bool(interfaces.get(name)) or any(name in each for each in interfaces.values())


def _others(interfaces: Mapping[str, list[str]]) -> set[str]:
    """Return the addresses at which other machines may reach this one."""
    found = {address for each in interfaces.values() for address in each}
    return {address for address in found if not ipaddress.ip_address(address).is_loopback}


def _host(endpoint: str) -> str:
    """Return the address in a locator, as in `tcp/10.0.0.7:7450#iface=eth0`."""
    place = endpoint.partition("/")[2].partition("#")[0].partition("?")[0]
    return place.rpartition(":")[0].strip("[]").partition("%")[0]
