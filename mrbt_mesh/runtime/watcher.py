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
# How often it is looked whether the manifest has changed, and which processes run.
MANIFEST_US, PROCESSES_US = SECOND_US // 4, SECOND_US
# A robot has mostly been heard so soon after its process has begun.
HEARD_WITHIN_US = 5 * SECOND_US


class Watcher:
    """Use it as `async with watching(...) as watcher`; then read `watcher.observer`."""

    def __init__(self, address: TeamAddress, batch_s: float = 0.0) -> None:
        """`batch_s`: for so long after messages were taken in, others wait to be taken in together.

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
        # Those of this machine that run: robot and pid -> since when that is known.
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
        """Why the team may not be found any more; empty if nothing is known."""
        return self._changes.problem if self._changes is not None else ""

    async def open(self) -> None:
        """Open the session; raises TransportError."""
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
        """Close the session, without waiting for long, and end the recording."""
        self._transport.close(CLOSE_TIMEOUT_S)
        for recording in self._recordings:
            recording.close()

    def begin_recording(self, to: RecordTo) -> None:
        """Record all that is heard, what is known already first. The recording begins with the
        mission that is in force now.

        Raises InputError if it cannot be written.
        """
        from mrbt_mesh.runtime.observer_recording import observer_recording

        keys = self._guard.keys if self._guard is not None else None
        self._recordings.append(observer_recording(to, self.observer, self.address.run, keys))

    def record_to(self, open_sink: Callable[[RunMetadata], MessageSink]) -> None:
        """Give another sink all that is recorded, what is known already first.

        Raises what `open_sink` does.
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
        """Take over which members there are now."""
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
        """Tell the observer which robots run, on this machine: who is silent need not be dead. And
        whether the run has ended, which goes on if it is continued.
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
        """Wait for news, at most `timeout_s`, and refresh."""
        before_us = self._looked_us or boottime_us()
        with anyio.move_on_after(timeout_s):
            await self.changed.wait()
        self.changed = anyio.Event()
        self._looked_us = boottime_us()
        # As a robot does: messages may be unread, so no robot is suspected for its own lag.
        lag_us = self._looked_us - before_us - round(timeout_s * SECOND_US)
        if lag_us > self.timing.heartbeat_us // 2:
            self.observer.membership.allow_for_own_lag(lag_us, self._looked_us)
        self.refresh()
        await self._follow_team()

    async def _follow_team(self) -> None:
        """Open the session anew if the robots have been started at other places."""
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
        """Wait until the observer holds what the team does, at most `timeout_s`."""
        with anyio.move_on_after(timeout_s):
            while not self.observer.caught_up:
                await self.wait_for_change(self.timing.heartbeat_us / SECOND_US)

    def _put(self, event: Input, key: str | None) -> bool:
        """Called by Zenoh's threads."""
        if isinstance(event, MessageReceived):
            event = replace(event, arrived_us=boottime_us())
        return self._inbox.put(event, key)

    def _wake(self) -> None:
        """Messages wait: the first one after a pause is taken in at once."""
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
            # Other inputs arrived before the message that follows them. A message has its own time:
            # one that was put behind it may have arrived before, in a thread that had to wait.
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
        """Hand on a message; one that is not authentic is noted among those refused."""
        if self._guard is not None:
            try:
                _, data = self._guard.open(data, kind, source, envelope)
            except RefusedError:
                # From now on this robot is asked in a later life.
                self._asked.discard((source, self.observer.membership.peers[source].incarnation))
                return
            except WireError as error:
                self.observer.refused[source] = str(error)
                return
        take(data, now_us)

    async def command(self, robot: str, command: str, argument: str = "") -> tuple[bool, str]:
        """Send a word to one robot: (whether it was obeyed, what it answered)."""
        good, answer = await self._ask(robot, command, argument)
        return good is True, str(answer)

    async def operate(
        self, robot: str, step: CommandStep, entry: Entry, passes_on: bool
    ) -> dict[str, Any] | None:
        """Ask one robot for a step of a command (`operate_body`); None: it gives no answer."""
        good, answer = await self._ask(robot, OPERATE, operate_body(step, entry, passes_on))
        if good is False:
            return {"refused": str(answer), "cause": INVALID}
        return answer if good and isinstance(answer, dict) else None

    async def _ask(self, robot: str, command: str, argument: Any) -> tuple[bool | None, Any]:
        """Whether a robot obeys (None: it does not answer), and what it says. Others may answer as
        well: what the robot has signed counts first.
        """
        header = self.observer.replica.header
        data = encode(header, MessageKind.COMMAND, command_body(command, argument))
        try:
            return await self._ask_once(robot, data)
        except RefusedError:
            # It is asked in a later life now, or as the process that has answered.
            try:
                return await self._ask_once(robot, data)
            except RefusedError as error:
                return None, str(error)

    async def _ask_once(self, robot: str, command: bytes) -> tuple[bool | None, Any]:
        """Send a command once; raises RefusedError if the robot takes none of this life."""
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
        """A command of this operator, signed in a team with keys. Raises ValueError."""
        keys = self._guard.keys if self._guard is not None else None
        return make_command(name, value, operator, version, self.address.run, keys)

    def _opened_answer(self, answer: bytes, robot: str) -> tuple[bytes, bool]:
        """(answer, whether it is authentic): robots that do not know our key answer without one."""
        if self._guard is None:
            return answer, True
        try:
            return self._guard.open(answer, MessageKind.ANSWER, robot)[1], True
        except ForgedError:
            return answer, False


def _safe(answer: Any) -> Any:
    """Plain data of a robot's answer, with texts that are safe to show."""
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
    """An open Watcher, which records what it hears if that is wanted.

    `tell_past` gives its observer what happened before it listens. `batch_s`: see `Watcher`.
    Raises TransportError if the session cannot be opened, InputError if nothing can be recorded.
    """
    watcher = Watcher(address, batch_s)
    if tell_past is not None:
        # In a thread: a long past takes seconds, in which views of other teams go on.
        await anyio.to_thread.run_sync(tell_past, watcher.observer)
    if record is not None:
        watcher.begin_recording(record)
    await watcher.open()
    try:
        yield watcher
    finally:
        watcher.close()
