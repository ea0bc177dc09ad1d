"""A router: passes messages between robots that are its clients, and to and from other routers.

It is a Zenoh session in router mode and knows nothing about teams; Zenoh's own program with
`deploy/zenohd.json5` does the same. With keys it admits members with a certificate of the team, and
Zenoh's access control lets each robot publish only under its own name.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.session_config import (
    RETRY,
    Certificates,
    TransportError,
    close_session,
    common_settings,
    open_session,
    tls_settings,
    without_ipv6,
    zenoh_config,
)
from mrbt_mesh.runtime.settings import ENCRYPTED, PROTOCOLS

PORT = 7447
# Silence after which clients drop a router; well below the default detection time.
ROUTER_LEASE_MS = 500
CLOSE_TIMEOUT_S = 1.0
ASK_TIMEOUT_S = 2.0
_PROTOCOLS = [protocol for protocols in PROTOCOLS.values() for protocol in protocols]
# Permissions of sessions with keys, as Zenoh's access control names them.
_ALL = [
    *("put", "delete", "query", "reply", "declare_subscriber", "declare_queryable"),
    *("liveliness_token", "liveliness_query", "declare_liveliness_subscriber"),
]


@dataclass(frozen=True)
class RouterConfig:
    """The configuration of a router. Endpoints are Zenoh locators.

    `members`: name -> role of those that may link; None: anyone may. Raises TransportError.
    """

    listen: tuple[str, ...]
    connect: tuple[str, ...] = ()
    certificates: Certificates | None = None
    members: Mapping[str, Role] | None = None

    def __post_init__(self) -> None:
        for endpoint in (*self.listen, *self.connect):
            protocol = endpoint.partition("/")[0]
            if protocol not in _PROTOCOLS or ":" not in endpoint:
                forms = ", ".join(f"{name}/IP:PORT" for name in _PROTOCOLS)
                raise TransportError(f"endpoint {endpoint!r}: one of {forms} is expected")
            if (protocol in ENCRYPTED) != (self.certificates is not None):
                text = "links over tls and quic need --keys, and with --keys there are no others"
                raise TransportError(f"endpoint {endpoint!r}: {text}")


def default_endpoint(has_keys: bool) -> str:
    """Return the default endpoint on which a router listens."""
    return f"{'tls' if has_keys else 'tcp'}/[::]:{PORT}"


def config_with_keys(folder: Path, listen: Iterable[str], connect: Iterable[str]) -> RouterConfig:
    """Return the configuration of the router whose key is in a folder.

    Raises KeysError or TransportError.
    """
    # Imported here because the library is large.
    from mrbt_mesh.runtime.key_folder import KeyFolder

    keys = KeyFolder(folder)
    members = {n: m.role for n, m in keys.manifest().members.items() if not m.is_revoked}
    certificates = keys.certificates_of(keys.router())
    return RouterConfig(tuple(listen), tuple(connect), certificates, members)


def router_settings(config: RouterConfig) -> dict[str, Any]:
    """Return a router's Zenoh configuration, by paths."""
    protocols = {endpoint.partition("/")[0] for endpoint in (*config.listen, *config.connect)}
    settings: dict[str, Any] = {
        "mode": "router",
        "listen/endpoints": without_ipv6(config.listen),
        "connect/endpoints": list(config.connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": RETRY,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/protocols": sorted(protocols),
        "transport/link/tx/lease": ROUTER_LEASE_MS,
        **common_settings(),
        # Robots ask here which links exist when a token has disappeared.
        "adminspace": {"enabled": True, "permissions": {"read": True, "write": False}},
    }
    if config.certificates is not None:
        settings["transport/link/tls"] = tls_settings(config.certificates)
    if config.members is not None:
        settings["access_control"] = access_control(config.members)
    return settings


def as_json(settings: Mapping[str, Any]) -> str:
    """Return settings by path as a configuration file for `zenohd`."""
    data: dict[str, Any] = {}
    for path, value in settings.items():
        *folders, name = path.split("/")
        at = data
        for folder in folders:
            at = at.setdefault(folder, {})
        at[name] = value
    return json.dumps(data, indent=2)


# -- permissions, by the common name of the certificate at the other end of a link ---------------


def access_control(members: Mapping[str, Role]) -> dict[str, Any]:
    """Return Zenoh's access control for a team's members.

    It holds for one hop: another router has already checked what it passes on.
    """
    names = sorted(members)
    rules = [
        _rule("hear", _ALL, ["**"], flow="egress"),
        _rule(
            "listen",
            ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"],
            ["mrbt/**"],
        ),
        _rule("ask", ["query"], [f"mrbt/*/{MessageKind.PULL}/*", "@/*/router"]),
        _rule("command", ["query"], [f"mrbt/*/{MessageKind.COMMAND}/*"]),
        _rule("watch", ["liveliness_token"], ["mrbt/*/alive/observer/**"]),
        _rule("route", _ALL, ["**"]),
    ]
    policies = [_policy("hear", names), _policy("listen", names), _policy("ask", names)]
    for role, allowed in (
        (Role.OPERATOR, ("command", "watch")),
        (Role.OBSERVER, ("watch",)),
        (Role.ROUTER, ("route",)),
    ):
        having = [name for name in names if members[name] is role]
        policies += [_policy(rule, having) for rule in allowed if having]
    for name in names:
        if members[name] is Role.ROBOT:
            own = _robot_rules(name)
            rules += own
            policies += [_policy(rule["id"], [name]) for rule in own]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in names],
        "policies": policies,
    }


def _robot_rules(name: str) -> list[dict[str, Any]]:
    beat, fact = MessageKind.HEARTBEAT, MessageKind.FACT
    said = [f"mrbt/*/{beat}/{name}", f"mrbt/*/{fact}/{name}", f"mrbt/*/to/*/{name}"]
    answered = [f"mrbt/*/{kind}/{name}" for kind in (MessageKind.PULL, MessageKind.COMMAND)]
    return [
        _rule(f"{name} says", ["put"], [*said, f"mrbt/*/watch/{name}"]),
        _rule(f"{name} answers", ["declare_queryable", "reply"], answered),
        _rule(f"{name} lives", ["liveliness_token"], [f"mrbt/*/alive/{name}/**"]),
    ]


def _rule(name: str, messages: list[str], keys: list[str], flow: str = "ingress") -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": keys,
    }


def _policy(rule: str, subjects: list[str]) -> dict[str, Any]:
    return {"rules": [rule], "subjects": subjects}


# -- a router at work -----------------------------------------------------------------------------


class Router:
    """A router's session. Raises TransportError if it cannot listen."""

    def __init__(self, config: RouterConfig) -> None:
        settings = zenoh_config(router_settings(config))
        try:
            self._session = open_session(settings, config.listen)
        except TransportError as error:
            text = "if something else listens there, choose another --listen"
            raise TransportError(f"{error}: {text}") from error
        self.locators = self._locators() or list(config.listen)

    def _locators(self) -> list[str]:
        """Return its endpoints, as others may reach them."""
        for reply in self._session.get(f"@/{self._session.zid()}/router", timeout=ASK_TIMEOUT_S):
            if reply.ok is not None:
                return [str(each) for each in json.loads(reply.ok.payload.to_bytes())["locators"]]
        return []

    def close(self) -> None:
        """Close the router without a long wait."""
        close_session(self._session, CLOSE_TIMEOUT_S)


def write_config(path: Path, config: RouterConfig) -> None:
    """Write a configuration for `zenohd` that only its owner can read. Raises InputError."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "w", encoding="utf-8") as file:
            file.write(as_json(router_settings(config)) + "\n")
    except FileExistsError:
        raise InputError(f"{path} exists already: choose another name, or remove it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
