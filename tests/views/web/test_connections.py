"""Whoever opens many connections, or says half a request, keeps nobody else out."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
import anyio.abc
import pytest

from mrbt_mesh.plugins import ViewerOptions
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.web import connections
from mrbt_mesh.views.web.app import Page
from mrbt_mesh.views.web.connections import MAX_CONNECTIONS, gives_way
from mrbt_mesh.views.web.feed import MAX_PAGES, Feed
from mrbt_mesh.views.web.server import served
from tests.support.watched import WELD, watched

HALF = b"GET / HTTP/1.1\r\nHost: HOST\r\n"
EVENTS = b"GET /events HTTP/1.1\r\nHost: HOST\r\n\r\n"


class Browser:
    """Connections to one page."""

    def __init__(self, port: int, feed: Feed) -> None:
        self.feed = feed
        self._port = port
        self._open: list[anyio.abc.SocketStream] = []

    async def ask(self, words: bytes) -> anyio.abc.SocketStream:
        """A connection that has said this."""
        stream = await anyio.connect_tcp("127.0.0.1", self._port)
        self._open.append(stream)
        await stream.send(words.replace(b"HOST", f"127.0.0.1:{self._port}".encode()))
        return stream

    async def close(self) -> None:
        for stream in self._open:
            await anyio.aclose_forcefully(stream)


@asynccontextmanager
async def browser() -> AsyncIterator[Browser]:
    script, observer = watched(WELD)
    feed = Feed(TeamView(observer), lambda: script.team.now_us)
    async with served(
        ViewerOptions(), feed.close, lambda hosts: Page(feed, hosts).application()
    ) as address:
        found = Browser(int(address.rstrip("/").rpartition(":")[2]), feed)
        try:
            yield found
        finally:
            await found.close()


async def wait_for(stream: anyio.abc.SocketStream, found: bytes) -> None:
    heard = b""
    while found not in heard.lower():
        heard += await stream.receive()


@pytest.mark.parametrize("words", [HALF, EVENTS], ids=["half requests", "event streams"])
async def test_one_that_opens_many_keeps_nobody_out(words: bytes) -> None:
    async with browser() as rogue:
        for _ in range(MAX_CONNECTIONS + 50):
            await rogue.ask(words)
        await wait_for(await rogue.ask(HALF + b"\r\n"), b"<!doctype html>")
        await wait_for(await rogue.ask(EVENTS), b"event: begin")
        assert rogue.feed.pages <= MAX_PAGES


async def test_half_a_request_ends_by_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also half a body, and half a second request; an event stream stays."""
    monkeypatch.setattr(connections, "REQUEST_TIMEOUT_S", 0.1)
    command = b"POST /commands HTTP/1.1\r\nHost: HOST\r\nContent-Length: 9\r\n\r\n{"
    async with browser() as slow:
        follows = await slow.ask(EVENTS)
        for words in (HALF, command, b"GET /mission HTTP/1.1\r\nHost: HOST\r\n\r\n" + HALF):
            stream = await slow.ask(words)
            with contextlib.suppress(anyio.EndOfStream, anyio.BrokenResourceError):
                while True:
                    await stream.receive()
        await wait_for(follows, b"event: begin")
        assert slow.feed.pages == 1


class Guest:
    def __init__(self, name: str, address: str, is_served: bool) -> None:
        self.name, self.address, self.is_served = name, address, is_served


def test_places_are_given_up_by_those_that_wait_and_have_most() -> None:
    guests = [
        Guest("served", "10.0.0.1", True),
        Guest("waits", "10.0.0.1", False),
        Guest("one of three", "10.0.0.2", False),
        Guest("another", "10.0.0.2", False),
        Guest("the last", "10.0.0.2", False),
    ]
    gone = []
    while guests:
        victim = gives_way(guests)
        guests.remove(victim)
        gone.append(victim.name)
    assert gone == ["one of three", "waits", "another", "the last", "served"]
