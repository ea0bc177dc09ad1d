"""The configuration of a robot's or an observer's Zenoh session: who dials whom, and timeouts.

The reasons are measurements: see `zenoh_transport`, and `router` for sessions through routers.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("ZENOH_RUNTIME", "(rx: (worker_threads: 16))")

import zenoh

from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.settings import ENCRYPTED, PROTOCOLS, WIRED, default_protocol

NO_IPV6 = "this machine has no IPv6"
# Discover others on all interfaces that support it.
AUTO = "auto"
_INTERNET = (socket.AF_INET, socket.AF_INET6)
LEASE_MS = 2_000
# Up to this many robots, links have the shortest lease.
FULL_LEASE_ROBOTS = 6
# How long a client tries one router before it tries the next.
ROUTER_OPEN_MS = 500
# Zenoh uses 22 with links; the rest is for blocking calls of both sides.
SESSION_THREADS = 32
RETRY = {"period_init_ms": 250, "period_max_ms": 500, "period_increase_factor": 1}


class TransportError(InputError):
    """The session cannot be opened; the message has the reason and the remedy."""


@dataclass(frozen=True)
class Certificates:
    """The certificates and key of a member for encrypted links, all three in PEM.

    `authority` is the team's certificate, which has signed the members' and is the only one
    trusted.
    """

    authority: str
    certificate: str
    private: str


@dataclass(frozen=True)
class TransportConfig:
    """How a session connects. `robot` is empty for an observer; endpoints are `tcp/127.0.0.1:7450`.

    `multicast_interface`: discover others on this interface (`auto`, `lo`, an address); None: do
    not. `certificates`: for encrypted links. `robots`: the number of robots in the team. `routers`:
    endpoints of the routers that it is a client of, one at a time; it has no other links then.
    Raises TransportError.
    """

    team: str
    robot: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    multicast_interface: str | None = None
    profile: str = WIRED
    certificates: Certificates | None = None
    robots: int = 1
    routers: tuple[str, ...] = ()

    @property
    def lease_ms(self) -> int:
        """A link that is silent for this long is dropped; four messages are sent in that time.

        Every robot has a link to every other one, so in a larger team fewer are sent over each.
        """
        robots = 1 if self.routers else self.robots
        return LEASE_MS * max(1, robots // FULL_LEASE_ROBOTS)

    @property
    def protocols(self) -> list[str]:
        """The protocols of its links."""
        given = {endpoint.partition("/")[0] for endpoint in self._endpoints()}
        return sorted(given) or [default_protocol(self.profile, self.certificates is not None)]

    def where(self) -> str:
        """Return where the session hears others, as readable text."""
        if self.routers:
            return f"router {', '.join(self.routers)}"
        parts = []
        if self.multicast_interface is not None:
            there = ", ".join(sorted(own_addresses().keys() - {"lo"})) or "lo alone"
            parts.append(f"multicast of {self.multicast_interface} ({there})")
        parts += [f"{name} {', '.join(ends)}" for name, ends in self._named_ends() if ends]
        parts += [NO_IPV6] if self.misses_ipv6() else []
        return "; ".join(parts)

    def misses_ipv6(self) -> bool:
        """True if it listens on all addresses but the machine has only IPv4."""
        return any(map(_is_any, self.listens_on())) and not has_ipv6()

    def listens_on(self) -> tuple[str, ...]:
        """Return the endpoints to listen on, even if none is given."""
        if self.listen or self.multicast_interface is None:
            return self.listen
        return (f"{self.protocols[0]}/[::]:0",)

    def _named_ends(self) -> list[tuple[str, tuple[str, ...]]]:
        return [("listening on", self.listen), ("dialling", self.connect)]

    def _endpoints(self) -> tuple[str, ...]:
        return (*self.listen, *self.connect, *self.routers)

    def __post_init__(self) -> None:
        if self.routers and (self.listen or self.connect or self.multicast_interface is not None):
            raise TransportError(
                "--router makes a client, which has no other links: leave out --listen, --connect "
                "and --multicast"
            )
        if self.multicast_interface is not None:
            check_interface(self.multicast_interface)
        allowed = PROTOCOLS[self.profile]
        for endpoint in self._endpoints():
            if endpoint.partition("/")[0] not in allowed:
                forms = " or ".join(f"{protocol}/IP:PORT" for protocol in allowed)
                raise TransportError(
                    f"endpoint {endpoint!r}: the transport {self.profile} needs {forms}"
                )
        encrypted = [protocol for protocol in self.protocols if protocol in ENCRYPTED]
        if encrypted and self.certificates is None:
            raise TransportError(
                f"links over {encrypted[0]} need the team's keys: make them with `mrbt keys init`, "
                "and give every robot its own with --keys"
            )


def has_ipv6() -> bool:
    """True if this machine can listen on all addresses of IPv6; some kernels lack it."""
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::", 0))
    except OSError:
        return False
    return True


def without_ipv6(endpoints: Sequence[str]) -> list[str]:
    """Return endpoints to listen on; without IPv6, `[::]` (all addresses) becomes `0.0.0.0`."""
    if not any(map(_is_any, endpoints)) or has_ipv6():
        return list(endpoints)
    return [each.replace("/[::]:", "/0.0.0.0:") for each in endpoints]


def _is_any(endpoint: str) -> bool:
    return "/[::]:" in endpoint


def own_addresses() -> dict[str, list[str]]:
    """Return the machine's interfaces, each with its addresses."""
    import psutil  # sessions without discovery do not need it

    return {
        name: [row.address.partition("%")[0] for row in rows if row.family in _INTERNET]
        for name, rows in psutil.net_if_addrs().items()
    }


def check_interface(name: str) -> None:
    """Check that the interfaces for discovery exist: names or addresses. Raises TransportError."""
    if name == AUTO:
        return
    interfaces = own_addresses()
    for each in (part.strip() for part in name.split(",")):
        if each not in interfaces and not any(each in found for found in interfaces.values()):
            listed = ", ".join(sorted(interfaces))
            raise TransportError(
                f"--multicast {each!r:.80}: this machine has no such interface or address "
                f"({listed})"
            )
        if each in interfaces and not interfaces[each]:
            raise TransportError(f"--multicast {each}: this interface has no address")


def require_threads() -> None:
    """Check that this process can start a session's threads, most of which start with a link.

    Zenoh does not report a failure: its session stays open and hears nobody. Raises TransportError.
    """
    over, threads = threading.Event(), list[threading.Thread]()
    try:
        for _ in range(SESSION_THREADS):
            thread = threading.Thread(target=over.wait, daemon=True)
            thread.start()
            threads.append(thread)
    except RuntimeError as error:
        raise TransportError(
            f"this process can start only {len(threads)} of {SESSION_THREADS} threads that a Zenoh "
            "session needs: raise the limit of processes (ulimit -u, pids.max of its cgroup or "
            "container)"
        ) from error
    finally:
        over.set()
        for thread in threads:
            thread.join()


def session_id(unix_ns: int) -> str:
    """Return a Zenoh session id: random, but greater than ids made earlier.

    Zenoh compares ids from their least significant byte on, and allows no leading zero.
    """
    noise = secrets.token_bytes(7) + bytes([0x80 | secrets.randbelow(0x80)])
    return f"{int.from_bytes(unix_ns.to_bytes(8, 'big') + noise, 'little'):x}"


def session_config(config: TransportConfig) -> zenoh.Config:
    """Return the Zenoh configuration. Raises TransportError for a locator that Zenoh refuses."""
    scouting: dict[str, Any] = {"enabled": False}
    if config.multicast_interface is not None:
        scouting = {
            "enabled": True,
            "interface": config.multicast_interface,
            "autoconnect": {"peer": ["router", "peer"]},
            "autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
        }
    settings: dict[str, Any] = {
        "mode": "peer",
        "connect/endpoints": list(config.connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": RETRY,
        "scouting/delay": 0,
        "scouting/multicast": scouting,
        "scouting/gossip/enabled": False,
        "transport/link/protocols": config.protocols,
        "transport/link/tx/lease": config.lease_ms,
        **common_settings(),
        "transport/unicast/open_timeout": LEASE_MS,
        "transport/unicast/accept_timeout": LEASE_MS,
    }
    settings["listen/endpoints"] = without_ipv6(config.listens_on())
    if config.routers:
        settings |= _client_settings(config)
    if config.certificates is not None:
        settings["transport/link/tls"] = tls_settings(config.certificates)
    if config.multicast_interface is not None:
        settings["id"] = session_id(time.time_ns())
    return zenoh_config(settings)


def _client_settings(config: TransportConfig) -> dict[str, Any]:
    """Settings for one attempt at each router: a client that waits for the first never tries the
    second.
    """
    return {
        "mode": "client",
        "connect/endpoints": list(config.routers),
        "connect/timeout_ms": 0,
        "transport/unicast/open_timeout": ROUTER_OPEN_MS,
    }


def common_settings() -> dict[str, Any]:
    """Return the settings shared by all sessions."""
    return {
        "transport/link/rx/max_message_size": 2 * MAX_MESSAGE_BYTES,
        # A killed process would leave shared-memory segments behind, and loopback is fast enough.
        "transport/shared_memory/enabled": False,
    }


def tls_settings(certificates: Certificates) -> dict[str, Any]:
    """Return settings for mutual TLS: both sides must show a certificate signed by the team.

    Certificates have no addresses, so names are not verified.
    """
    certificate, private = _encoded(certificates.certificate), _encoded(certificates.private)
    return {
        "root_ca_certificate_base64": _encoded(certificates.authority),
        "listen_certificate_base64": certificate,
        "listen_private_key_base64": private,
        "connect_certificate_base64": certificate,
        "connect_private_key_base64": private,
        "enable_mtls": True,
        "verify_name_on_connect": False,
    }


def _encoded(pem: str) -> str:
    return base64.b64encode(pem.encode()).decode()


def zenoh_config(settings: Mapping[str, Any]) -> zenoh.Config:
    """Return a configuration from settings by path. Raises TransportError if Zenoh refuses one."""
    result = zenoh.Config()
    for key, value in settings.items():
        try:
            result.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            shown = "what it was given" if "tls" in key else repr(value)
            raise TransportError(f"Zenoh refuses {key} = {shown}: {error}") from error
    return result


def close_session(session: zenoh.Session, timeout_s: float) -> None:
    """Close a session, waiting at most `timeout_s`: an isolated one takes 10 s, and may raise."""

    def close() -> None:
        with contextlib.suppress(zenoh.ZError):
            session.close()

    thread = threading.Thread(target=close, daemon=True)
    thread.start()
    thread.join(timeout_s)


def open_session(settings: zenoh.Config, where: Iterable[str]) -> zenoh.Session:
    """Open a session. Raises TransportError that names `where` it was to listen or connect."""
    try:
        return zenoh.open(settings)
    except zenoh.ZError as error:
        # What follows is a path in Zenoh's own sources.
        reason = str(error).partition(" at /")[0].partition(" [")[0].strip(" :")
        named = ", ".join(where) or "any port"
        raise TransportError(f"cannot open a Zenoh session on {named}: {reason}") from error
