"""The transport around a Zenoh session that does not do as it should."""

from __future__ import annotations

import asyncio
import json
import threading
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from mrbt_mesh.core.agent.effects import AskRouter
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    InputRefused,
    MessageReceived,
    RouterAnswered,
    TokenChanged,
)
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES, MessageKind
from mrbt_mesh.runtime import zenoh_transport
from mrbt_mesh.runtime.session_config import TransportConfig
from mrbt_mesh.runtime.token_holders import CHANGES_AT_ONCE, MAX_LIVES
from mrbt_mesh.runtime.zenoh_transport import (
    MAX_QUERY_BYTES,
    TOO_MANY_TOKENS,
    ZenohTransport,
    linked_sessions,
)

LIFE = Incarnation(3, "n")
LIVES = {"A1": LIFE, "C1": LIFE}
PUT, DELETE = zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE


class LingeringSession:
    """Does not come back from closing, as an isolated one for 10 s."""

    def __init__(self) -> None:
        self.may_close = threading.Event()
        self.closing: threading.Thread | None = None

    def close(self) -> None:
        self.closing = threading.current_thread()
        self.may_close.wait()

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: self


def test_whoever_closes_does_not_wait_for_a_session_that_lingers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = LingeringSession()
    monkeypatch.setattr(zenoh_transport.zenoh, "open", lambda _: session)
    transport = ZenohTransport(TransportConfig("team", "A1"), lambda *_: True, LIVES.get)
    transport.open()
    transport.close(0.01)
    while session.closing is None:
        threading.Event().wait(0.001)
    assert session.closing.daemon, "a process may end without it"
    session.may_close.set()
    session.closing.join()


class Heard:
    """A transport and what it delivers of tokens."""

    def __init__(self) -> None:
        self.inputs: list[Input] = []
        self.transport = ZenohTransport(
            TransportConfig("team", "B1", routers=("tcp/127.0.0.1:1",)),
            self.deliver,
            LIVES.get,
        )
        self.slots: list[str | None] = []
        self.listed = threading.Event()
        self.listed.set()

    def deliver(self, event: Input, slot: str | None) -> bool:
        self.inputs.append(event)
        self.slots.append(slot)
        return True

    def token(self, kind: zenoh.SampleKind, rest: str) -> None:
        sample = SimpleNamespace(key_expr=f"mrbt/team/alive/{rest}", kind=kind)
        self.transport._on_token(sample, self.listed)  # type: ignore[arg-type]


def test_a_token_names_the_router_of_its_robot() -> None:
    heard = Heard()
    heard.token(PUT, "A1/3/n/aa/r1")
    heard.token(DELETE, "A1/3/n/aa/r1")
    heard.token(PUT, "C1/3/n/cc/direct")
    assert heard.inputs == [
        TokenChanged("A1", LIFE, True, "r1"),
        TokenChanged("A1", LIFE, False, "r1"),
        TokenChanged("C1", LIFE, True, ""),
    ]
    assert heard.slots[0] == heard.slots[1] != heard.slots[2], "the last state replaces others"


def test_the_end_of_a_token_that_another_one_has_replaced_means_nothing() -> None:
    """So it is when a robot's token names its new router, or its session was opened anew."""
    heard = Heard()
    heard.token(PUT, "A1/3/n/aa/r1")
    heard.token(PUT, "A1/3/n/aa/r2")
    heard.token(DELETE, "A1/3/n/aa/r1")
    heard.token(PUT, "A1/3/n/bb/r2")
    heard.token(DELETE, "A1/3/n/aa/r2")
    assert [event.held for event in heard.inputs if isinstance(event, TokenChanged)] == [True] * 3
    heard.token(DELETE, "A1/3/n/bb/r2")
    assert heard.inputs[-1] == TokenChanged("A1", LIFE, False, "r2")


@pytest.mark.parametrize(
    "rest", ["A1/3/n/aa", "A1/3/n/aa/r1/x", "a b/3/n/aa/r1", "A1/x/n/aa/r1", "**"]
)
def test_tokens_of_nobody_are_refused(rest: str) -> None:
    heard = Heard()
    heard.token(PUT, rest)
    assert heard.inputs == [InputRefused("a stranger", TOO_MANY_TOKENS, 1)]


def test_a_token_in_this_robot_s_own_name_is_no_news() -> None:
    heard = Heard()
    heard.token(PUT, "B1/3/n/aa/direct")
    heard.token(DELETE, "B1/3/n/aa/direct")
    assert all(isinstance(event, InputRefused) for event in heard.inputs)


def test_a_flood_is_counted_by_the_robot_in_whose_name_it_comes() -> None:
    heard = Heard()
    for number in range(CHANGES_AT_ONCE + 2):
        heard.token(PUT, f"A1/{number + 4}/n/aa/direct")
    heard.listed.clear()
    heard.token(PUT, "A1/99/n/aa/direct")  # listed once more: it was counted before
    assert set(heard.inputs) == {InputRefused("A1's token", TOO_MANY_TOKENS, 1)}
    assert len(heard.inputs) == CHANGES_AT_ONCE + 2 - MAX_LIVES


def answer(router: str, *sessions: str) -> bytes:
    return json.dumps({"zid": router, "sessions": [{"peer": each} for each in sessions]}).encode()


@pytest.mark.parametrize(
    ("answers", "is_linked", "is_asked_again"),
    [
        ([answer("r1", "bb"), answer("r2")], False, False),
        ([answer("r1", "aa", "bb"), answer("r2")], True, True),
        ([answer("r1", "bb"), answer("r2", "aa")], True, False),
        ([answer("r2", "bb")], None, False),
        ([b"{", b"[]", b'{"zid": "r1"}', b'{"zid": "r1", "sessions": [1]}'], None, False),
        ([b"x" * (zenoh_transport.MAX_ROUTER_ANSWER_BYTES + 1)], None, False),
        ([], None, False),
    ],
)
def test_what_routers_say_of_a_robot_whose_token_is_gone(
    monkeypatch: pytest.MonkeyPatch,
    answers: list[bytes],
    is_linked: bool | None,
    is_asked_again: bool,
) -> None:
    heard = with_routers(monkeypatch, [answers, answers])
    again: list[AskRouter] = []
    asked = AskRouter("A1", LIFE, "r1")
    heard.transport.ask_routers([asked], again.append)
    assert again == [asked] * is_asked_again
    heard.transport.ask_routers([asked])
    assert heard.inputs[1:] == [RouterAnswered("A1", LIFE, is_linked)] * (2 - is_asked_again)


async def test_a_router_that_still_lists_the_link_of_a_killed_robot_is_asked_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    linked, ended = [answer("r1", "aa", "bb")], [answer("r1", "bb")]
    heard = with_routers(monkeypatch, [linked, linked, ended])
    monkeypatch.setattr(zenoh_transport, "ROUTER_AGAIN_S", (0, 0, 0))
    heard.transport.ask_router(AskRouter("A1", LIFE, "r1"))
    async with asyncio.timeout(30):
        while len(heard.inputs) < 2:
            await asyncio.sleep(0)
    assert heard.inputs[1:] == [RouterAnswered("A1", LIFE, False)]


def with_routers(monkeypatch: pytest.MonkeyPatch, turns: list[list[bytes]]) -> Heard:
    """A transport that has heard A1's token; routers answer so, one turn after the other."""

    class Session:
        def get(self, selector: str, handler: tuple[Any, Any], **_: Any) -> None:
            assert selector == "@/*/router"
            on_reply, on_end = handler
            for data in turns.pop(0):
                payload = zenoh.ZBytes(data)
                on_reply(SimpleNamespace(ok=SimpleNamespace(payload=payload)))
            on_end()

    def callback(on_reply: Any, on_end: Any, **_: Any) -> tuple[Any, Any]:
        return on_reply, on_end

    monkeypatch.setattr(zenoh_transport, "Callback", callback)
    heard = Heard()
    heard.token(PUT, "A1/3/n/aa/r1")
    heard.transport._session = Session()  # type: ignore[assignment]
    return heard


async def test_a_closed_session_asks_nobody() -> None:
    heard = Heard()
    for robot in ("A1", "C1"):
        heard.transport.ask_router(AskRouter(robot, LIFE, "r1"))
    await asyncio.sleep(0)
    assert heard.inputs == [RouterAnswered(robot, LIFE, None) for robot in ("A1", "C1")]


def test_an_answer_lists_sessions_by_router() -> None:
    assert linked_sessions(answer("r1", "aa", "bb")) == {"r1": frozenset({"aa", "bb"})}
    assert linked_sessions(b"\xff") == {}


def heard(key: str, data: bytes, is_believed: bool = True) -> tuple[ZenohTransport, Input]:
    """A transport to which this has come, and what it made of it."""
    got: list[Input] = []

    def deliver(event: Input, _: str | None) -> bool:
        got.append(event)
        return is_believed

    payload = type("Payload", (bytes,), {"to_bytes": lambda self: bytes(self)})(data)
    transport = ZenohTransport(TransportConfig("team", "A1"), deliver, LIVES.get)
    sample: Any = SimpleNamespace(key_expr=key, payload=payload)
    transport._on_sample(sample, MessageKind.HEARTBEAT)
    (event,) = got
    return transport, event


def test_a_link_is_heard_when_its_robot_is_and_not_when_a_stranger_says_so() -> None:
    for is_believed in (True, False):
        transport, event = heard("mrbt/team/beat/B1", b"x", is_believed)
        assert event == MessageReceived(MessageKind.HEARTBEAT, "B1", b"x")
        assert (transport.heard_us("B1") is not None) is is_believed


def test_what_is_too_large_or_comes_under_no_robots_name_is_refused_unread() -> None:
    _, event = heard("mrbt/team/beat/B1", bytes(MAX_MESSAGE_BYTES + 1))
    assert event == InputRefused("B1", f"more than {MAX_MESSAGE_BYTES} bytes", 1)
    transport, event = heard("mrbt/team/beat/not%a%robot", b"x")
    assert event == InputRefused("a stranger", "published under no robot's name", 1)
    assert transport.heard_us("not%a%robot") is None


class Question:
    """A query of a stranger, and what is known of it when it is let go."""

    def __init__(self, size: int, attached: int | None = None) -> None:
        self.payload = zenoh.ZBytes(bytes(size))
        self.attachment = None if attached is None else zenoh.ZBytes(bytes(attached))


@pytest.mark.parametrize(
    ("size", "attached", "is_passed_on", "kept"),
    [
        (10, None, True, 1),
        (10, None, False, 0),
        (MAX_QUERY_BYTES + 1, None, True, 0),
        (10, MAX_QUERY_BYTES, True, 0),
    ],
)
def test_no_question_is_kept_that_is_large_or_is_not_passed_on(
    size: int, attached: int | None, is_passed_on: bool, kept: int
) -> None:
    transport = ZenohTransport(TransportConfig("team", "A1"), lambda *_: is_passed_on, LIVES.get)
    question: Any = Question(size, attached)
    transport._on_query(question, MessageKind.PULL)
    assert len(transport._queries) == kept


def test_an_answer_that_is_too_large_is_refused_unread(monkeypatch: pytest.MonkeyPatch) -> None:
    class Session:
        def get(self, _: str, handler: tuple[Any, Any], **__: Any) -> None:
            for size in (MAX_MESSAGE_BYTES + 1, 10):
                payload = zenoh.ZBytes(bytes(size))
                handler[0](SimpleNamespace(ok=SimpleNamespace(payload=payload)))
            handler[1]()

    monkeypatch.setattr(zenoh_transport, "Callback", lambda *handler, **_: handler)
    heard = Heard()
    heard.transport._session = Session()  # type: ignore[assignment]
    heard.transport.ask("A1", MessageKind.PULL, b"x", 1)
    refused = InputRefused("an answer", f"more than {MAX_MESSAGE_BYTES} bytes", 1)
    assert heard.inputs == [refused, AnswerReceived("A1", bytes(10))]


async def test_what_is_asked_in_one_turn_of_the_loop_is_one_question(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    transport = ZenohTransport(TransportConfig("team", "A1"), lambda *_: True, LIVES.get)
    asked: list[list[str]] = []
    monkeypatch.setattr(
        transport, "ask_routers", lambda asks, _: asked.append([each.robot for each in asks])
    )
    for robots in (["A1", "B1"], ["C1"]):
        for robot in robots:
            transport.ask_router(AskRouter(robot, LIFE, "r1"))
        assert robots not in asked, "others may follow"
        await asyncio.sleep(0)
    assert asked == [["A1", "B1"], ["C1"]]
