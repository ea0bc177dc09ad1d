"""Watches a team over Zenoh: an Observer with a session of its own. It sends no beats."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import anyio

from mrbt_mesh.core.agent.effects import AskRouter
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    InputRefused,
    MessageReceived,
    RouterAnswered,
    TokenChanged,
)
from mrbt_mesh.core.agent.operator_messages import (
    INVALID,
    OPERATE,
    CommandStep,
    command_body,
    operate_body,
)
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version
from mrbt_mesh.core.facts.values import printable
from mrbt_mesh.core.membership.envelope import Envelope, ForgedError, Guard, RefusedError
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.membership.wire import MessageKind, WireError, decode, encode
from mrbt_mesh.observer.newest import LIVE_ENTRIES
from mrbt_mesh.observer.observer import Observer, RunEnd
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.flood_gate import FloodGate
from mrbt_mesh.runtime.inbox import Inbox
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.session_config import TransportConfig, TransportError, require_threads
from mrbt_mesh.runtime.solver_loader import chosen_engine
from mrbt_mesh.runtime.team_address import TeamAddress, keys_of, observer_transport
from mrbt_mesh.runtime.team_changes import TeamChanges
from mrbt_mesh.runtime.token_holders import life_of
from mrbt_mesh.runtime.zenoh_transport import ZenohTransport

if TYPE_CHECKING:  # most watchers record nothing
    from mrbt_mesh.recording.messages import MessageSink
    from mrbt_mesh.recording.metadata import RunMetadata
    from mrbt_mesh.recording.observer_recorder import ObserverRecorder
    from mrbt_mesh.runtime.observer_recording import RecordTo
    from mrbt_mesh.runtime.recording import GuardedRecorder

CLOSE_TIMEOUT_S = 0.5
COMMAND_TIMEOUT_S = 10.0
# How often to check whether the manifest has changed, and which processes run.
MANIFEST_US, PROCESSES_US = SECOND_US // 4, SECOND_US
# A robot is usually heard within this time after its process has begun.
HEARD_WITHIN_US = 5 * SECOND_US


class Watcher:
    """An observer connected to a team: use `watching(...)`, then read `watcher.observer`."""

    def __init__(self, address: TeamAddress, batch_s: float = 0.0) -> None:
        """After messages were processed, further ones wait `batch_s` to be processed together.

        Raises KeysError.
        """
        self.address = address
        self.timing = address.timing
        keys, self._manifest = keys_of(address.keys)
        life = time.time_ns() // 1_000
        self._guard = Guard(keys, address.run, life) if keys is not None else None
        self.observer = Observer(
            address.mission,
            address.run,
            address.timing,
            default_solver,
            chosen_engine(),
            keys,
            LIVE_ENTRIES,
        )
        self.observer.speed = address.speed
        self._recordings: list[GuardedRecorder[ObserverRecorder]] = []
        self.changed = anyio.Event()
        self._asked: set[tuple[str, Incarnation]] = set()
        self._next_look_us = self._next_processes_us = 0
        # Running processes on this machine: robot and pid -> since when they are known.
        self._processes: dict[tuple[str, int], int] = {}
        self._changes = self._changes_of(address)
        self._told = ""
        self._looked_us = self._taken_us = 0
        self._batch_s, self._next_batch_s = batch_s, 0.0
        self._inbox: Inbox
        self._gate: FloodGate
        self._transport: ZenohTransport

    @staticmethod
    def _changes_of(address: TeamAddress) -> TeamChanges | None:
        if address.run_dir is None:
            return None

        def read(run_dir: RunDir) -> TransportConfig:
            return observer_transport(run_dir, run_dir.info())

        return TeamChanges(address.run_dir, address.transport, read)

    @property
    def problem(self) -> str:
        """Why the team may have become unreachable; empty if nothing is known."""
        return self._changes.problem if self._changes is not None else ""

    async def open(self) -> None:
        """Open the session. Raises TransportError."""
        require_threads()
        self._inbox = Inbox(asyncio.get_running_loop(), self._wake, are_beats_quiet=True)
        keys = self._guard.keys if self._guard is not None else None
        transport = self.address.transport
        is_shared = bool(transport.routers)
        run = self.address.run
        self._gate = FloodGate(keys, run, self._put, is_link_shared=is_shared)
        lives = life_of(lambda: self.observer.membership.peers, keys)
        self._transport = ZenohTransport(transport, self._gate.deliver, lives)
        await anyio.to_thread.run_sync(self._transport.open)
        self._transport.declare_token(Incarnation(0, secrets.token_hex(4)))

    def close(self) -> None:
        """Close the session without a long wait, and end the recordings."""
        self._transport.close(CLOSE_TIMEOUT_S)
        for recording in self._recordings:
            recording.close()

    def begin_recording(self, to: RecordTo) -> None:
        """Record everything that is heard, starting with what is already known.

        The recording begins with the mission now in force. Raises InputError if it cannot be
        written.
        """
        from mrbt_mesh.runtime.observer_recording import observer_recording

        keys = self._guard.keys if self._guard is not None else None
        self._recordings.append(observer_recording(to, self.observer, self.address.run, keys))

    def record_to(self, open_sink: Callable[[RunMetadata], MessageSink]) -> None:
        """Also record to another sink, starting with what is already known.

        Raises what `open_sink` raises.
        """
        from mrbt_mesh.recording.observer_recorder import ObserverRecorder
        from mrbt_mesh.runtime.observer_recording import observer_metadata, to_observers_record

        observer, has_keys = self.observer, self._guard is not None
        sink = open_sink(observer_metadata(observer, self.address.run, has_keys))
        recording = to_observers_record(ObserverRecorder(sink, observer), observer)
        self._recordings.append(recording)
        recording.do(lambda recorder: recorder.update(boottime_us()))

    def refresh(self) -> None:
        """Bring the observer up to date, and ask for facts that it lacks."""
        self._take_waiting()
        for event in self._inbox.take_quiet(self._taken_us):
            self._take(event, event.arrived_us or self._taken_us)
        now_us = boottime_us()
        self._look_at_manifest(now_us)
        self._look_at_processes(now_us)
        replica = self.observer.replica
        self.observer.update(now_us)
        self._inbox.are_beats_quiet = not self.observer.membership.has_suspects
        for recording in self._recordings:
            recording.do(lambda recorder: recorder.update(now_us))
        peers = self.observer.membership.peers
        fresh = [
            r for r, p in peers.items() if p.heartbeat and (r, p.incarnation) not in self._asked
        ]
        for robot in sorted({*replica.peers_to_ask(now_us), *fresh}):
            self._asked.add((robot, peers[robot].incarnation))
            replica.anti_entropy.mark_asked(robot, now_us)
            timeout_s = self.timing.ask_timeout_us / 1e6
            pull = self._sealed(replica.write_pull(), robot)
            self._transport.ask(robot, MessageKind.PULL, pull, timeout_s)

    def _look_at_manifest(self, now_us: int) -> None:
        """Apply a new manifest of the members."""
        manifest = self._manifest
        if manifest is None or now_us < self._next_look_us:
            return
        self._next_look_us = now_us + MANIFEST_US
        if not manifest.look():
            return
        if manifest.problem:
            self.observer.record.say(now_us, f"the new manifest is refused: {manifest.problem}")
        elif manifest.is_revoked:
            text = "the observer's own key has been revoked or replaced: start again"
            self.observer.record.say(now_us, text)

    def _look_at_processes(self, now_us: int) -> None:
        """Tell the observer which robots run on this machine, since a silent robot need not be
        dead.

        Also tell it whether the run has ended; a run that is continued has not.
        """
        run_dir, before = self.address.run_dir, self._processes
        if run_dir is None or now_us < self._next_processes_us:
            return
        self._next_processes_us = now_us + PROCESSES_US
        found = ((robot, process.pid) for robot, process in run_dir.living().items())
        self._processes = {each: before.get(each, now_us) for each in found}
        self.observer.running = frozenset(
            robot
            for (robot, _), since_us in self._processes.items()
            if now_us - since_us >= HEARD_WITHIN_US or robot in self.observer.membership.peers
        )

        if (summary := None if self._processes else run_dir.summary()) is None:
            self.observer.ended = None
        elif self.observer.ended is None:
            result, because = summary.get("result"), summary.get("ended_because")
            self.observer.ended = RunEnd(str(result), str(because or ""), now_us)
            self.changed.set()

    async def wait_for_change(self, timeout_s: float) -> None:
        """Wait for news, at most `timeout_s`, then refresh."""
        before_us = self._looked_us or boottime_us()
        with anyio.move_on_after(timeout_s):
            await self.changed.wait()
        self.changed = anyio.Event()
        self._looked_us = boottime_us()
        # Like a robot, allow for own lag: messages may be unread, so no robot is suspected for it.
        lag_us = self._looked_us - before_us - round(timeout_s * SECOND_US)
        if lag_us > self.timing.heartbeat_us // 2:
            self.observer.membership.allow_for_own_lag(lag_us, self._looked_us)
        self.refresh()
        await self._follow_team()

    async def _follow_team(self) -> None:
        """Reconnect if the robots have been started at other endpoints."""
        if self._changes is None:
            return
        now_us = boottime_us()
        found = self._changes.look(now_us)
        if self.problem != self._told:
            self._told = self.problem
            if self.problem:
                self.observer.record.say(now_us, self.problem)
        if found is None:
            return
        self.observer.record.say(now_us, "the robots are at other places now: connecting anew")
        try:
            await anyio.to_thread.run_sync(self._transport.reopen, found)
        except TransportError as error:
            self.observer.record.say(now_us, str(error))

    async def catch_up(self, timeout_s: float) -> None:
        """Wait until the observer has the team's facts, at most `timeout_s`."""
        with anyio.move_on_after(timeout_s):
            while not self.observer.caught_up:
                await self.wait_for_change(self.timing.heartbeat_us / SECOND_US)

    def _put(self, event: Input, key: str | None) -> bool:
        """Queue an input. Called on Zenoh's threads."""
        if isinstance(event, MessageReceived):
            event = replace(event, arrived_us=boottime_us())
        return self._inbox.put(event, key)

    def _wake(self) -> None:
        """Schedule the processing of messages. The first one after a pause is processed at once."""
        loop = asyncio.get_running_loop()
        wait_s = max(0.0, self._next_batch_s - loop.time())
        self._next_batch_s = loop.time() + wait_s + self._batch_s
        loop.call_later(wait_s, self._drain)

    def _drain(self) -> None:
        self._take_waiting()
        self.changed.set()

    def _take_waiting(self) -> None:
        waiting, at_us = [*self._inbox.take(), *self._gate.take_refused()], boottime_us()
        timed: list[tuple[Input, int]] = []
        for event in reversed(waiting):
            # Other inputs get the time of the message that follows them. A message has its own
            # time: a message that is queued later may have arrived earlier, on a thread that had to
            # wait.
            if isinstance(event, MessageReceived):
                at_us = event.arrived_us or at_us
            timed.append((event, at_us))
        for event, at_us in reversed(timed):
            self._take(event, max(self._taken_us, at_us))

    def _take(self, event: Input, now_us: int) -> None:
        observer, self._taken_us = self.observer, now_us
        match event:
            case MessageReceived(kind, source, data, envelope):
                take = partial(self._message, kind, source)
                self._open(data, kind, source, take, now_us, envelope)
            case TokenChanged(robot, incarnation, held, router):
                if observer.membership.receive_token(robot, incarnation, held, router):
                    self._transport.ask_router(AskRouter(robot, incarnation, router))
            case InputRefused(source, reason):
                observer.refused[source] = reason
            case RouterAnswered(robot, incarnation, is_linked):
                observer.membership.router_answered(robot, incarnation, is_linked)
            case AnswerReceived(peer, data) if data is not None:
                self._open(data, MessageKind.STATE, peer, partial(observer.state, peer), now_us)
            case _:
                pass

    def _message(self, kind: MessageKind, source: str, data: bytes, now_us: int) -> None:
        self.observer.message(kind, source, data, now_us)
        for recording in self._recordings:
            recording.do(lambda recorder: recorder.message(kind, source, data, now_us))

    def _sealed(self, data: bytes, to: str) -> bytes:
        return self._guard.seal(data, (to,)) if self._guard is not None else data

    def _open(
        self,
        data: bytes,
        kind: MessageKind,
        source: str,
        take: Callable[[bytes, int], None],
        now_us: int,
        envelope: Envelope | None = None,
    ) -> None:
        """Pass a message on. One that is not authentic is noted as refused."""
        if self._guard is not None:
            try:
                _, data = self._guard.open(data, kind, source, envelope)
            except RefusedError:
                # Requests to this robot are sealed for a later life from now on.
                self._asked.discard((source, self.observer.membership.peers[source].incarnation))
                return
            except WireError as error:
                self.observer.refused[source] = str(error)
                return
        take(data, now_us)

    async def command(self, robot: str, command: str, argument: str = "") -> tuple[bool, str]:
        """Send a command to one robot. Returns whether it obeyed, and its answer."""
        good, answer = await self._ask(robot, command, argument)
        return good is True, str(answer)

    async def operate(
        self, robot: str, step: CommandStep, entry: Entry, passes_on: bool
    ) -> dict[str, Any] | None:
        """Ask one robot for a step of a command (`operate_body`).

        Returns None if it does not answer.
        """
        good, answer = await self._ask(robot, OPERATE, operate_body(step, entry, passes_on))
        if good is False:
            return {"refused": str(answer), "cause": INVALID}
        return answer if good and isinstance(answer, dict) else None

    async def _ask(self, robot: str, command: str, argument: Any) -> tuple[bool | None, Any]:
        """Return whether a robot obeys (None: no answer), and its answer.

        Others may answer as well: an answer signed by the robot takes precedence.
        """
        header = self.observer.replica.header
        data = encode(header, MessageKind.COMMAND, command_body(command, argument))
        try:
            return await self._ask_once(robot, data)
        except RefusedError:
            # The retry uses a later life, or addresses the process that has answered.
            try:
                return await self._ask_once(robot, data)
            except RefusedError as error:
                return None, str(error)

    async def _ask_once(self, robot: str, command: bytes) -> tuple[bool | None, Any]:
        """Send a command once.

        Raises RefusedError if the robot refuses commands from this session.
        """
        sealed = command if self._guard is None else self._guard.seal_command(command, robot)
        loop, answers = asyncio.get_running_loop(), asyncio.Queue[bytes | None]()

        def deliver(event: Input, _: str | None) -> None:
            if isinstance(event, AnswerReceived):
                loop.call_soon_threadsafe(answers.put_nowait, event.data)

        self._transport.ask(robot, MessageKind.COMMAND, sealed, COMMAND_TIMEOUT_S, deliver)
        good, doubtful = None, f"{robot} does not answer"
        while (answer := await answers.get()) is not None:
            try:
                inner, is_authentic = self._opened_answer(answer, robot)
                _, body = decode(inner, self.observer.replica.header, MessageKind.ANSWER)
                is_obeyed, found = body
            except RefusedError:
                raise
            except (WireError, ValueError, TypeError) as error:
                doubtful = printable(f"{robot} answered something strange: {error}")
                continue
            if is_authentic:
                return bool(is_obeyed), _safe(found)
            good, doubtful = False, printable(str(found))
        return good, doubtful

    def make_command(self, name: str, value: Any, operator: str, version: Version) -> Entry:
        """Return this operator's command as an entry, signed in a team with keys.

        Raises ValueError.
        """
        keys = self._guard.keys if self._guard is not None else None
        return make_command(name, value, operator, version, self.address.run, keys)

    def _opened_answer(self, answer: bytes, robot: str) -> tuple[bytes, bool]:
        """Return the answer and whether it is authentic.

        Robots that do not know our key answer unsigned.
        """
        if self._guard is None:
            return answer, True
        try:
            return self._guard.open(answer, MessageKind.ANSWER, robot)[1], True
        except ForgedError:
            return answer, False


def _safe(answer: Any) -> Any:
    """Return the plain data of a robot's answer with its texts made safe to print."""
    if isinstance(answer, str):
        return printable(answer)
    if isinstance(answer, list):
        return [_safe(each) for each in answer]
    if isinstance(answer, dict):
        return {_safe(name): _safe(each) for name, each in answer.items()}
    return answer


@asynccontextmanager
async def watching(
    address: TeamAddress,
    record: RecordTo | None = None,
    tell_past: Callable[[Observer], None] | None = None,
    batch_s: float = 0.0,
) -> AsyncIterator[Watcher]:
    """Yield an open Watcher, which records what it hears if `record` is given.

    `tell_past` gives the observer past events before it listens. `batch_s`: see `Watcher`. Raises
    TransportError if the session cannot be opened, InputError if it cannot record.
    """
    watcher = Watcher(address, batch_s)
    if tell_past is not None:
        # In a thread: a long history takes seconds, during which views of other teams must go on.
        await anyio.to_thread.run_sync(tell_past, watcher.observer)
    if record is not None:
        watcher.begin_recording(record)
    await watcher.open()
    try:
        yield watcher
    finally:
        watcher.close()
