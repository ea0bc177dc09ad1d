"""The only module that talks to Zenoh.

Facts that shaped it (eclipse-zenoh 1.10, measured):
- A link that both sides dial can merge into a stale one after a one-sided lease expiry, and
  links found by gossip are never dialled again: so every pair is dialled by one side only,
  from explicit endpoints (or multicast scouting with `greater-zid`), and gossip is off.
- With `greater-zid` only the session of the greater id dials whom it discovers, and sessions
  look around less and less often, down to every 8 s. Ids grow with time, so that a newcomer
  dials everybody at once; with clocks that differ, it may be found 8 s later.
- A session can be split for good while its transport looks alive: `link_watch` looks out for
  it, and the session is reopened.
- Closing a dead TCP link lingers on a receive thread: there are 16 of them.
- Closing an isolated session may take 10 s and raise: it happens on a daemon thread.
- A closed QUIC session may hold its port for a second or two.
- BLOCK can stall the caller and then drop the link: everything is sent with DROP; lost facts
  are repaired by the agents.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("ZENOH_RUNTIME", "(rx: (worker_threads: 16))")

import zenoh
from zenoh.handlers import Callback

from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    InputRefused,
    MessageReceived,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES, MAX_NONCE, MessageKind
from mrbt_mesh.core.mission.names import is_robot_id
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.flood_gate import NO_SOURCE, Deliver
from mrbt_mesh.runtime.settings import PROTOCOLS, WIRED, WIRELESS
from mrbt_mesh.runtime.token_holders import TokenHolders

LEASE_MS = 2_000
# Up to here links are watched as closely as they can be.
FULL_LEASE_ROBOTS = 6
REOPEN_CLOSE_TIMEOUT_S = 1.0
OBSERVER = "observer"
# Whose message it is that comes under no robot's name; what is said of one that is not read.
NOBODY, TOO_LARGE = "a stranger", f"more than {MAX_MESSAGE_BYTES} bytes"


class TransportError(InputError):
    """The session cannot be opened; the message says why and what to change."""


@dataclass(frozen=True)
class TransportConfig:
    """`robot` is empty for an observer. Endpoints are Zenoh locators, `tcp/127.0.0.1:7450`.

    `multicast_interface`: scout on this interface (`auto`, `lo`, an address); None: do not.
    `key`: file with the team's key, for `wireless` (see `team_key`). `robots`: how many there
    are in the team. Raises TransportError.
    """

    team: str
    robot: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    multicast_interface: str | None = None
    profile: str = WIRED
    key: Path | None = None
    robots: int = 1

    @property
    def lease_ms(self) -> int:
        """After so long without a word a link is given up; four are said in that time.

        Every robot has a link to every other one, so in a larger team less is said over each.
        """
        return LEASE_MS * max(1, self.robots // FULL_LEASE_ROBOTS)

    def __post_init__(self) -> None:
        protocol = PROTOCOLS[self.profile]
        for endpoint in (*self.listen, *self.connect):
            if not endpoint.startswith(f"{protocol}/"):
                raise TransportError(
                    f"endpoint {endpoint!r}: the transport {self.profile} needs {protocol}/IP:PORT"
                )
        if (self.key is not None) != (self.profile == WIRELESS):
            raise TransportError(
                "the transport wireless, and only that, needs the team's key: "
                "make one with `mrbt key FILE`, and give it to every robot with --key"
            )
        if self.key is not None and not os.access(self.key, os.R_OK):
            raise TransportError(f"the team's key {self.key} cannot be read")


def session_id(unix_ns: int) -> str:
    """A Zenoh session id, random but greater than those of earlier times.

    Zenoh compares ids from their least significant byte on, and wants no leading zero.
    """
    noise = secrets.token_bytes(7) + bytes([0x80 | secrets.randbelow(0x80)])
    return f"{int.from_bytes(unix_ns.to_bytes(8, 'big') + noise, 'little'):x}"


def session_config(config: TransportConfig) -> zenoh.Config:
    """The Zenoh configuration; raises TransportError for a locator that Zenoh refuses."""
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
        "connect/retry": {
            "period_init_ms": 250,
            "period_max_ms": 500,
            "period_increase_factor": 1,
        },
        "scouting/delay": 0,
        "scouting/multicast": scouting,
        "scouting/gossip/enabled": False,
        "transport/link/protocols": [PROTOCOLS[config.profile]],
        "transport/link/tx/lease": config.lease_ms,
        "transport/link/rx/max_message_size": 2 * MAX_MESSAGE_BYTES,
        # A killed process would leave its segments behind; loopback is fast enough.
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": LEASE_MS,
        "transport/unicast/accept_timeout": LEASE_MS,
    }
    listen = list(config.listen)
    if not listen and config.multicast_interface is not None:
        listen = [f"{PROTOCOLS[config.profile]}/[::]:0"]
    settings["listen/endpoints"] = listen
    if config.key is not None:
        # One key for the whole team, shown and demanded on both sides: who lacks it stays out.
        # Certificates say nothing of addresses, so names are not compared.
        key = str(config.key)
        settings["transport/link/tls"] = {
            "root_ca_certificate": key,
            "listen_certificate": key,
            "listen_private_key": key,
            "connect_certificate": key,
            "connect_private_key": key,
            "enable_mtls": True,
            "verify_name_on_connect": False,
        }
    if config.multicast_interface is not None:
        settings["id"] = session_id(time.time_ns())
    result = zenoh.Config()
    for key, value in settings.items():
        try:
            result.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            raise TransportError(f"Zenoh refuses {key} = {value!r}: {error}") from error
    return result


class ZenohTransport:
    """One session: publishes, asks and answers, and turns what arrives into agent inputs.

    `deliver(input, key)` is called on Zenoh's threads; see `Inbox.put` and `FloodGate.deliver`.
    """

    def __init__(self, config: TransportConfig, deliver: Deliver) -> None:
        self._config = config
        self._deliver = deliver
        self._prefix = f"mrbt/{config.team}"
        self._session: zenoh.Session | None = None
        self._token: zenoh.LivelinessToken | None = None
        self._incarnation: Incarnation | None = None
        self._queries: dict[int, zenoh.Query] = {}
        self._query_number = 0
        self._lock = threading.Lock()
        self._zids: dict[str, str] = {}
        self._heard_us: dict[str, int] = {}
        self._holders = TokenHolders()

    # -- life of the session --------------------------------------------------------------

    def open(self) -> None:
        """Open the session and subscribe; raises TransportError. Blocks: call it in a thread."""
        try:
            session = zenoh.open(session_config(self._config))
        except zenoh.ZError as error:
            where = ", ".join(self._config.listen) or "any port"
            # What follows is a path in Zenoh's own sources.
            reason = str(error).partition(" at /")[0].partition(" [")[0]
            raise TransportError(f"cannot open a Zenoh session on {where}: {reason}") from error
        keys = [(f"{kind}/*", kind) for kind in (MessageKind.HEARTBEAT, MessageKind.FACT)]
        # What goes to some goes once more to whoever watches.
        to = f"to/{self._config.robot}/*" if self._config.robot else "watch/*"
        for key, kind in [*keys, (to, MessageKind.HEARTBEAT)]:
            session.declare_subscriber(
                f"{self._prefix}/{key}", self._callback(self._on_sample, kind)
            )
        with self._lock:
            self._holders.clear()
        session.liveliness().declare_subscriber(
            f"{self._prefix}/alive/**", self._callback(self._on_token, None), history=True
        )
        robot = self._config.robot
        if robot:
            for kind in (MessageKind.PULL, MessageKind.COMMAND):
                session.declare_queryable(
                    f"{self._prefix}/{kind}/{robot}", self._callback(self._on_query, kind)
                )
        self._session = session
        if self._incarnation is not None:
            self.declare_token(self._incarnation)

    def close(self, timeout_s: float) -> None:
        """Close the session, waiting at most `timeout_s`; an isolated one takes 10 s."""
        session, self._session, self._token = self._session, None, None
        if session is None:
            return

        def finish() -> None:
            try:
                session.close()
            except zenoh.ZError:
                return  # nobody is left to tell

        thread = threading.Thread(target=finish, daemon=True)
        thread.start()
        thread.join(timeout_s)

    def reopen(self) -> None:
        """Replace the session by a new one: the only repair for a split one.

        Raises TransportError while the old one still holds its port; then call it again.
        """
        self.close(REOPEN_CLOSE_TIMEOUT_S)
        self.open()

    def heard_us(self, robot: str) -> int | None:
        """When, on `boottime_us`, a beat last came from the robot itself, over its own link."""
        return self._heard_us.get(robot)

    def linked(self) -> frozenset[str]:
        """Robots to which there is a transport, whatever comes over it."""
        session = self._session
        if session is None:
            return frozenset()
        try:
            zids = {str(zid) for zid in session.info.peers_zid()}
        except zenoh.ZError:
            return frozenset()  # closed in another thread just now
        return frozenset(robot for robot, zid in self._zids.copy().items() if zid in zids)

    # -- sending --------------------------------------------------------------------------

    def publish(self, kind: MessageKind, data: bytes, to: tuple[str, ...] | None = None) -> None:
        """Send to these robots and to whoever watches, or to everybody.

        What is sent while the session is being reopened is lost.
        """
        session = self._session
        if session is None:
            return
        places = (str(kind),) if to is None else (*(f"to/{robot}" for robot in to), "watch")
        # It may be closed in another thread meanwhile.
        with contextlib.suppress(zenoh.ZError):
            for place in places:
                session.put(
                    f"{self._prefix}/{place}/{self._config.robot}",
                    data,
                    congestion_control=zenoh.CongestionControl.DROP,
                    priority=zenoh.Priority.REAL_TIME,
                    express=True,
                    allowed_destination=zenoh.Locality.REMOTE,
                )

    def ask(
        self,
        peer: str,
        kind: MessageKind,
        data: bytes,
        timeout_s: float,
        deliver: Callable[[Input, str | None], object] | None = None,
    ) -> None:
        """Ask one robot; the pages of its answer, or None if there is none, come to `deliver`.

        One that is given here gets None in any case, as the end of all answers.
        """
        give: Callable[[Input, str | None], object] = deliver or self._deliver
        session = self._session
        if session is None:
            give(AnswerReceived(peer, None), None)
            return
        answered = threading.Event()

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                answered.set()
                give(AnswerReceived(peer, reply.ok.payload.to_bytes()), None)

        def on_end() -> None:
            if deliver is not None or not answered.is_set():
                give(AnswerReceived(peer, None), None)

        try:
            session.get(
                f"{self._prefix}/{kind}/{peer}",
                Callback(on_reply, on_end, indirect=False),
                payload=data,
                timeout=timeout_s,
                # Or Zenoh would ask only whoever says that he knows all, who may be anybody.
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )
        except zenoh.ZError:
            give(AnswerReceived(peer, None), None)

    def reply(self, query: int, pages: tuple[bytes, ...]) -> None:
        """Answer a query that was delivered as QueryReceived."""
        with self._lock:
            found = self._queries.pop(query, None)
        if found is not None:
            # The session that asked may have been replaced meanwhile.
            with contextlib.suppress(zenoh.ZError):
                for page in pages:
                    found.reply(found.key_expr, page)
                found.drop()

    def declare_token(self, incarnation: Incarnation) -> None:
        """Show the liveliness token of this incarnation and take an older one down."""
        self._incarnation = incarnation
        session = self._session
        if session is None:
            return
        old = self._token
        who = self._config.robot or OBSERVER
        with contextlib.suppress(zenoh.ZError):
            self._token = session.liveliness().declare_token(
                f"{self._prefix}/alive/{who}/{incarnation.counter}/{incarnation.nonce}"
                f"/{session.zid()}"
            )
            if old is not None:
                old.undeclare()

    # -- receiving, on Zenoh's threads ----------------------------------------------------

    def _callback(self, function: Callable[[Any, Any], None], argument: Any) -> Callback[Any]:
        return Callback(lambda item: function(item, argument), indirect=False)

    def _on_sample(self, sample: zenoh.Sample, kind: MessageKind) -> None:
        source = str(sample.key_expr).rpartition("/")[2]
        if not is_robot_id(source):
            self._deliver(InputRefused(NOBODY, "published under no robot's name", 1), None)
        elif len(sample.payload) > MAX_MESSAGE_BYTES:
            self._deliver(InputRefused(source, TOO_LARGE, 1), None)
        else:
            is_beat = kind is MessageKind.HEARTBEAT
            key = f"beat/{source}" if is_beat else None
            event = MessageReceived(kind, source, sample.payload.to_bytes())
            if self._deliver(event, key) and is_beat:
                self._heard_us[source] = boottime_us()

    def _on_token(self, sample: zenoh.Sample, _: None) -> None:
        parts = str(sample.key_expr).removeprefix(f"{self._prefix}/alive/").split("/")
        if len(parts) != 4 or not is_robot_id(parts[0]) or parts[0] == self._config.robot:
            return
        robot, counter, nonce, zid = parts
        if not counter.isdecimal() or len(counter) > 15 or len(nonce) > MAX_NONCE:
            return
        held, incarnation = sample.kind == zenoh.SampleKind.PUT, Incarnation(int(counter), nonce)
        if held:
            self._zids[robot] = zid
        with self._lock:
            news = self._holders.change(robot, incarnation, zid, held)
        if news is not None:
            self._deliver(TokenChanged(robot, incarnation, news), None)

    def _on_query(self, query: zenoh.Query, kind: MessageKind) -> None:
        payload = query.payload
        if payload is not None and len(payload) > MAX_MESSAGE_BYTES:
            self._deliver(InputRefused(NO_SOURCE, TOO_LARGE, 1), None)
            return
        with self._lock:
            self._query_number += 1
            number = self._query_number
            self._queries[number] = query
            # Queries that the agent never came to are given up, oldest first.
            while len(self._queries) > 1_000:
                del self._queries[min(self._queries)]
        data = payload.to_bytes() if payload is not None else b""
        self._deliver(QueryReceived(number, kind, data), None)
