"""A robot's or an observer's Zenoh session.

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
- A client with several routers is linked to one, and to the next within some ms of its end; peers
  with the same endpoints are not. It loses all tokens then, and gets them back. Sessions
  linked to another router lose those of the dead one's clients, as if they had been killed: which
  it is, only a router knows, in its administration space.
- A client that waits for its first router does not try the second: it does not wait.
- BLOCK can stall the caller and then drop the link: everything is sent with DROP; lost facts
  are repaired by the agents.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import zenoh
from zenoh.handlers import Callback

from mrbt_mesh.core.agent.effects import AskRouter
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    InputRefused,
    MessageReceived,
    QueryReceived,
    RouterAnswered,
    TokenChanged,
)
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES, MAX_NONCE, MessageKind
from mrbt_mesh.core.mission.names import is_robot_id
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.flood_gate import AN_ANSWER, NO_SOURCE, NOBODY, Deliver
from mrbt_mesh.runtime.session_config import (
    TransportConfig,
    TransportError,
    close_session,
    open_session,
    session_config,
)
from mrbt_mesh.runtime.token_holders import OBSERVER, Change, Holder, LifeOf, TokenHolders

REOPEN_CLOSE_TIMEOUT_S = 1.0
# How long a robot, and an observer, wait for the first router to answer.
ROUTER_WAIT_S, OBSERVER_WAIT_S, ROUTER_RETRY_S = 30.0, 3.0, 0.25
# How long a router may take to list its links, and the maximum size of its answer.
ROUTER_ANSWER_S = 0.5
# A router ends a token before it forgets the link. While it still lists the link, it is asked again
# after these times.
ROUTER_AGAIN_S = (0.05, 0.1, 0.2, 0.4, 0.8)
MAX_ROUTER_ANSWER_BYTES = 1 << 20
NO_ROUTER = "direct"
# Reasons for refusing an input.
TOO_LARGE = f"more than {MAX_MESSAGE_BYTES} bytes"
# A question names at most 1,000 robots, with a digest each.
MAX_QUERIES, MAX_QUERY_BYTES = 1_000, 128 << 10
QUERY_TOO_LARGE = f"more than {MAX_QUERY_BYTES} bytes"
TOO_MANY_TOKENS = "too many liveliness tokens to check"


class ZenohTransport:
    """One Zenoh session: publishes, asks, answers, and turns what arrives into agent inputs.

    `deliver(input, key)` is called on Zenoh's threads (see `Inbox.put` and `FloodGate.deliver`),
    and so is `life_of`.
    """

    def __init__(self, config: TransportConfig, deliver: Deliver, life_of: LifeOf) -> None:
        self._config = config
        self._deliver = deliver
        self._prefix = f"mrbt/{config.team}"
        self._session: zenoh.Session | None = None
        # The token, and the router that it names.
        self._token: tuple[zenoh.LivelinessToken, str] | None = None
        self._incarnation: Incarnation | None = None
        self._queries: dict[int, zenoh.Query] = {}
        self._query_number = 0
        self._lock = threading.Lock()
        # Questions that wait, by how often they were asked before.
        self._asked: dict[int, list[AskRouter]] = {}
        self._heard_us: dict[str, int] = {}
        self._holders = TokenHolders(life_of)
        self._token_subscriber: zenoh.Subscriber[Any] | None = None

    # -- life of the session --------------------------------------------------------------

    def open(self) -> None:
        """Open the session and subscribe. Raises TransportError. Blocks, so call it in a thread."""
        config = self._config
        if config.routers:
            session = self._open_client()
        else:
            session = open_session(session_config(config), config.listen)
        keys = [(f"{kind}/*", kind) for kind in (MessageKind.HEARTBEAT, MessageKind.FACT)]
        # Messages to specific robots are sent a second time for observers.
        to = f"to/{self._config.robot}/*" if self._config.robot else "watch/*"
        for key, kind in [*keys, (to, MessageKind.HEARTBEAT)]:
            session.declare_subscriber(
                f"{self._prefix}/{key}", self._callback(self._on_sample, kind)
            )
        self._list_tokens(session)
        robot = self._config.robot
        if robot:
            for kind in (MessageKind.PULL, MessageKind.COMMAND):
                session.declare_queryable(
                    f"{self._prefix}/{kind}/{robot}", self._callback(self._on_query, kind)
                )
        self._session = session
        if self._incarnation is not None:
            self.declare_token(self._incarnation)

    def _list_tokens(self, session: zenoh.Session) -> None:
        """Subscribe to tokens: all that exist are delivered first, then their changes."""
        with self._lock:
            self._holders.clear()
        listed = threading.Event()
        subscriber = session.liveliness().declare_subscriber(
            f"{self._prefix}/alive/**", self._callback(self._on_token, listed), history=True
        )
        listed.set()
        self._token_subscriber = subscriber

    def follow_tokens(self) -> None:
        """List all tokens again if some were skipped (`TokenHolders`).

        Blocks, so call it in a thread.
        """
        session, before = self._session, self._token_subscriber
        with self._lock:
            is_due = self._holders.must_list_again()
        if is_due and session is not None and before is not None:
            with contextlib.suppress(zenoh.ZError):
                before.undeclare()
                self._list_tokens(session)

    def _open_client(self) -> zenoh.Session:
        """Open a client session, waiting for a router. Raises TransportError."""
        settings = session_config(self._config)
        until_s = time.monotonic() + (ROUTER_WAIT_S if self._config.robot else OBSERVER_WAIT_S)
        while True:
            try:
                return zenoh.open(settings)
            except zenoh.ZError as error:
                if time.monotonic() > until_s:
                    listed = ", ".join(self._config.routers)
                    text = f"no router answers at {listed}: start one with `mrbt router`"
                    raise TransportError(text) from error
            time.sleep(ROUTER_RETRY_S)

    def close(self, timeout_s: float) -> None:
        """Close the session, waiting at most `timeout_s`: an isolated session takes 10 s."""
        session, self._session, self._token = self._session, None, None
        if session is not None:
            close_session(session, timeout_s)

    def reopen(self, config: TransportConfig | None = None) -> None:
        """Replace the session by a new one, which is the only repair for a split session.

        `config` replaces the configuration. Raises TransportError while the old session still holds
        its port; then call it again.
        """
        self._config = config or self._config
        self.close(REOPEN_CLOSE_TIMEOUT_S)
        self.open()

    def heard_us(self, robot: str) -> int | None:
        """Return when the last beat came from the robot itself, over its own link, on
        `boottime_us`.
        """
        return self._heard_us.get(robot)

    def linked(self) -> frozenset[str]:
        """Return the robots to which there is a transport, whatever is sent over it.

        Empty for a client, whose only link is the one to its router.
        """
        session = self._session
        if session is None or self._config.routers:
            return frozenset()
        try:
            zids = {str(zid) for zid in session.info.peers_zid()}
        except zenoh.ZError:
            return frozenset()  # closed in another thread just now
        with self._lock:
            return self._holders.robots_of(zids)

    # -- sending --------------------------------------------------------------------------

    def publish(self, kind: MessageKind, data: bytes, to: tuple[str, ...] | None = None) -> None:
        """Send to the robots in `to` and to observers; None sends to all.

        Messages sent while the session is being reopened are lost.
        """
        session = self._session
        if session is None:
            return
        places = (str(kind),) if to is None else (*(f"to/{robot}" for robot in to), "watch")
        # The session may be closed in another thread meanwhile.
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
        """Ask one robot. The pages of its answer, or None if there is none, go to `deliver`.

        A `deliver` that is given here always gets None as the end of all answers.
        """
        give: Callable[[Input, str | None], object] = deliver or self._deliver
        session = self._session
        if session is None:
            give(AnswerReceived(peer, None), None)
            return
        answered = threading.Event()

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is None:
                return
            answered.set()
            if len(reply.ok.payload) > MAX_MESSAGE_BYTES:
                self._deliver(InputRefused(AN_ANSWER, TOO_LARGE, 1), None)
            else:
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
                # Otherwise Zenoh asks only a session that claims to be complete, perhaps a
                # stranger's.
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )
        except zenoh.ZError:
            give(AnswerReceived(peer, None), None)

    def ask_router(self, effect: AskRouter, times: int = 0) -> None:
        """Ask a router that was asked `times` before. Call it in the event loop.

        When a router dies, the tokens of all its clients end at once, so questions of one loop turn
        are sent as one.
        """
        asked = self._asked.setdefault(times, [])
        asked.append(effect)
        if len(asked) == 1:
            loop = asyncio.get_running_loop()

            def again(effect: AskRouter) -> None:
                with contextlib.suppress(RuntimeError):  # the loop has been closed
                    loop.call_soon_threadsafe(
                        loop.call_later, ROUTER_AGAIN_S[times], self.ask_router, effect, times + 1
                    )

            more = again if times < len(ROUTER_AGAIN_S) else None
            loop.call_soon(lambda: self.ask_routers(self._asked.pop(times), more))

    def ask_routers(
        self, asked: Sequence[AskRouter], again: Callable[[AskRouter], None] | None = None
    ) -> None:
        """Ask all routers for their links, and deliver a RouterAnswered for each robot.

        One question covers all robots, and all routers are asked because a robot may have moved to
        another router. If the router that the question names still lists a link to the robot,
        `again` is called instead.
        """
        session = self._session
        links: dict[str, frozenset[str]] = {}

        def on_reply(reply: zenoh.Reply) -> None:
            payload = reply.ok.payload if reply.ok is not None else None
            if payload is not None and len(payload) <= MAX_ROUTER_ANSWER_BYTES:
                links.update(linked_sessions(payload.to_bytes()))

        def on_end() -> None:
            for ask in asked:
                session_id = self._holders.last_session(ask.robot, ask.incarnation)
                at = [router for router in sorted(links) if session_id in links[router]]
                if ask.router in at and again is not None:
                    again(ask)
                    continue
                is_known = bool(at) or (ask.router in links and session_id != "")
                answer = bool(at) if is_known else None
                self._deliver(RouterAnswered(ask.robot, ask.incarnation, answer), None)

        try:
            if session is None:
                raise zenoh.ZError("closed")
            session.get(
                "@/*/router",
                Callback(on_reply, on_end, indirect=False),
                timeout=ROUTER_ANSWER_S,
                express=True,
            )
        except zenoh.ZError:
            on_end()

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
        """Declare the liveliness token of this incarnation, and withdraw an older one."""
        self._incarnation = incarnation
        session = self._session
        if session is None:
            return
        old = self._token
        who = self._config.robot or OBSERVER
        with contextlib.suppress(zenoh.ZError):
            router = _router_of(session)
            token = session.liveliness().declare_token(
                f"{self._prefix}/alive/{who}/{incarnation.counter}/{incarnation.nonce}"
                f"/{session.zid()}/{router or NO_ROUTER}"
            )
            self._token = token, router
            if old is not None:
                old[0].undeclare()

    def follow_router(self) -> None:
        """Declare the token again if this session is now linked to another router."""
        session, token = self._session, self._token
        if session is None or token is None or not self._config.routers:
            return
        with contextlib.suppress(zenoh.ZError):
            if _router_of(session) not in ("", token[1]) and self._incarnation is not None:
                self.declare_token(self._incarnation)

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

    def _on_token(self, sample: zenoh.Sample, listed: threading.Event) -> None:
        """Process a change of a token.

        Until all are `listed`, this is not called on a link's thread.
        """
        token = _parse_token(str(sample.key_expr).removeprefix(f"{self._prefix}/alive/"))
        source, change = NOBODY, Change.PASSED_OVER
        if token is not None:
            robot, incarnation, holder = token
            held = sample.kind == zenoh.SampleKind.PUT
            with self._lock:
                change = self._holders.change(robot, incarnation, holder, held)
                source = f"{robot}'s token" if self._holders.knows(robot) else NOBODY
        if change is Change.PASSED_OVER:
            if listed.is_set():
                self._deliver(InputRefused(source, TOO_MANY_TOKENS, 1), None)
        elif change is not Change.NOTHING and token is not None:
            event = TokenChanged(robot, incarnation, change is Change.HELD, holder.router)
            # A later change of the same incarnation replaces it.
            self._deliver(event, f"token/{robot}/{incarnation}")

    def _on_query(self, query: zenoh.Query, kind: MessageKind) -> None:
        payload, attachment = query.payload, query.attachment
        # A query is kept in memory until it is answered.
        if sum(len(part) for part in (payload, attachment) if part is not None) > MAX_QUERY_BYTES:
            self._deliver(InputRefused(NO_SOURCE, QUERY_TOO_LARGE, 1), None)
            return
        with self._lock:
            self._query_number += 1
            number = self._query_number
            self._queries[number] = query
            # Queries that the agent never answered are dropped, oldest first.
            while len(self._queries) > MAX_QUERIES:
                del self._queries[min(self._queries)]
        data = payload.to_bytes() if payload is not None else b""
        if not self._deliver(QueryReceived(number, kind, data), None):
            with self._lock:
                self._queries.pop(number, None)


def _parse_token(name: str) -> tuple[str, Incarnation, Holder] | None:
    """Parse the part of a token's key after the team; None if it is not a robot's token."""
    parts = name.split("/")
    if len(parts) != 5 or not is_robot_id(parts[0]):
        return None
    robot, counter, nonce, session, router = parts
    if not counter.isdecimal() or len(counter) > 15 or len(nonce) > MAX_NONCE:
        return None
    holder = Holder(session, "" if router == NO_ROUTER else router)
    return robot, Incarnation(int(counter), nonce), holder


def _router_of(session: zenoh.Session) -> str:
    """Return the router to which a client is linked now; empty for a peer."""
    return next((str(zid) for zid in session.info.routers_zid()), "")


def linked_sessions(answer: bytes) -> dict[str, frozenset[str]]:
    """Parse a router's answer: its id -> the sessions it has links to. Empty if malformed."""
    try:
        data = json.loads(answer)
        return {str(data["zid"]): frozenset(str(each["peer"]) for each in data["sessions"])}
    except (ValueError, TypeError, KeyError, RecursionError):
        return {}
