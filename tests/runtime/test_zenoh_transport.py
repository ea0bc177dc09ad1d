"""The transport around a Zenoh session that does not do as it should."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from mrbt_mesh.runtime import zenoh_transport
from mrbt_mesh.runtime.session_config import TransportConfig
from mrbt_mesh.runtime.zenoh_transport import ZenohTransport


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
