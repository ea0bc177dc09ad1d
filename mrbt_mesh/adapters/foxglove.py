"""Serves the channels that an observer records live, over Foxglove's websocket protocol.

Needs the extra `foxglove`. The library serves from threads of its own; this module's code runs in
the event loop in which the team is watched.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable, Mapping
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

import anyio

from mrbt_mesh.errors import InputError, require
from mrbt_mesh.plugins import OpenView, ViewerOptions, check_listens
from mrbt_mesh.recording.channels import BEATS, CHANNELS, DROPPED, FACTS
from mrbt_mesh.recording.messages import MessageEncoder
from mrbt_mesh.recording.metadata import RunMetadata

if TYPE_CHECKING:
    from foxglove.websocket import ChannelView, Client

    from mrbt_mesh.core.facts.store import Entry
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.watcher import Watcher

# The default port in Foxglove's dialog.
PORT = 8765
# The library keeps this many messages for a slow viewer, then drops the oldest. It is more than the
# current messages of a large team, all of which a late viewer gets at once.
BACKLOG_MESSAGES = 1 << 16


class FoxgloveViewer:
    """Shows live everything that a recording of the team would contain."""

    summary = "Serve the team to Foxglove: open a connection (Foxglove WebSocket) to the address."

    def check(self, options: ViewerOptions) -> None:
        """Raise InputError if the extra is missing, or if it could not listen."""
        _require()
        check_listens(options.host, _port(options), "Foxglove's protocol")

    @asynccontextmanager
    async def showing(
        self, watcher: Watcher, team: Team | None, options: ViewerOptions
    ) -> AsyncIterator[OpenView]:
        """Serve the team until the watcher is closed. Raises InputError if it cannot listen."""
        port = _port(options)
        opened: list[FoxgloveServer] = []

        def open_sink(metadata: RunMetadata) -> FoxgloveServer:
            opened.append(FoxgloveServer(metadata, options.host, port))
            return opened[0]

        watcher.record_to(open_sink)
        yield OpenView(opened[0].address, lambda: None, anyio.Event())


viewer = FoxgloveViewer()


def _port(options: ViewerOptions) -> int:
    return PORT if options.port is None else options.port


class FoxgloveServer:
    """A sink for an observer's recorder. `address` is that of the websocket.

    When a viewer subscribes to a channel, the channel's current messages are sent again to all its
    viewers, because the library cannot address a single one.
    """

    def __init__(self, metadata: RunMetadata, host: str, port: int) -> None:
        """Start the server; `port` 0: any free port. Must be called in a running event loop.

        Raises InputError if the extra is missing, or if it cannot serve.
        """
        _require()
        from foxglove import Channel, Context, Schema, start_server

        self._loop = asyncio.get_running_loop()
        self._encoder = MessageEncoder(metadata)
        self._standing: dict[str, dict[tuple[Any, ...], tuple[int, bytes]]] = {
            topic: {} for topic in CHANNELS
        }
        # The context of the server's channels.
        self._context = context = Context()
        self._channels = {
            topic: Channel(
                topic,
                message_encoding="json",
                schema=Schema(name=each.name, encoding="jsonschema", data=each.schema_text),
                context=context,
            )
            for topic, each in CHANNELS.items()
            if topic != BEATS
        }
        # The library calls those methods of a listener that exist.
        listener: Any = _Listener(self)
        try:
            self._server = start_server(
                name=f"mrbt {metadata.run}",
                host=host,
                port=port,
                context=context,
                server_listener=listener,
                message_backlog_size=BACKLOG_MESSAGES,
            )
        except (RuntimeError, OverflowError, ValueError) as error:
            self._close_channels()
            text = str(error).removeprefix("FoxgloveError: ")
            raise InputError(f"cannot serve Foxglove at {host} port {port}: {text}") from None
        shown = f"[{host}]" if ":" in host else host
        self.address = f"ws://{shown}:{self._server.port}"

    @property
    def epoch_ns(self) -> int:
        """The Unix time, in nanoseconds, at which the observer's clock was 0."""
        return self._encoder.epoch_ns

    def write(self, topic: str, at_us: int, data: Mapping[str, Any]) -> None:
        """Send a message to all subscribers of its channel."""
        at_ns, text = self._encoder.encode(topic, at_us, data)
        self._keep(topic, data, (at_ns, text))
        self._channels[topic].log(text, log_time=at_ns)

    def _keep(self, topic: str, data: Mapping[str, Any], message: tuple[int, bytes]) -> None:
        fields = CHANNELS[topic].stands_for
        if fields is not None:
            self._standing[topic][tuple([data[name] for name in fields])] = message
        elif topic == DROPPED:
            self._standing[FACTS].pop((data["author"], data["name"]), None)

    def asked(self, topic: str) -> None:
        """Send a channel's current messages to a new viewer. May be called from any thread."""
        # The loop may have ended before the server.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._send_current, topic)

    def _send_current(self, topic: str) -> None:
        for at_ns, text in self._standing[topic].values():
            self._channels[topic].log(text, log_time=at_ns)

    def flush(self, now_us: int) -> None:
        """Do nothing: messages are not buffered."""

    @property
    def is_full(self) -> bool:
        """Always False: nothing is stored."""
        return False

    def begin_part(
        self, mission: Mission, facts: Iterable[Entry], about: Mapping[str, Any], now_us: int
    ) -> None:
        """Do nothing. Never called, because the sink is never full."""

    def abandon(self) -> None:
        """Stop the server."""
        self.close()

    def close(self) -> None:
        """Stop the server and close its channels."""
        self._server.stop()
        self._close_channels()

    def _close_channels(self) -> None:
        for channel in self._channels.values():
            channel.close()


class _Listener:
    """Callbacks of the library, called from its threads."""

    def __init__(self, server: FoxgloveServer) -> None:
        self._server = server

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._server.asked(channel.topic)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        pass

    def on_client_advertise(self, client: Client, channel: Any) -> None:
        pass

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        pass

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        pass


def _require() -> None:
    require("Foxglove's protocol", "foxglove", "foxglove")
