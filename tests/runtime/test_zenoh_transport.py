"""The transport around a Zenoh session that does not do as it should."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from mrbt_mesh.core.agent.inputs import Input, InputRefused, MessageReceived
from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES, MessageKind
from mrbt_mesh.runtime import zenoh_transport
from mrbt_mesh.runtime.zenoh_transport import TransportConfig, ZenohTransport


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
    transport = ZenohTransport(TransportConfig("team", "A1"), lambda *_: None)
    transport.open()
    transport.close(0.01)
    while session.closing is None:
        threading.Event().wait(0.001)
    assert session.closing.daemon, "a process may end without it"
    session.may_close.set()
    session.closing.join()


def heard(key: str, data: bytes, is_believed: bool = True) -> tuple[ZenohTransport, Input]:
    """A transport to which this has come, and what it made of it."""
    got: list[Input] = []

    def deliver(event: Input, _: str | None) -> bool:
        got.append(event)
        return is_believed

    payload = type("Payload", (bytes,), {"to_bytes": lambda self: bytes(self)})(data)
    transport = ZenohTransport(TransportConfig("team", "A1"), deliver)
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
