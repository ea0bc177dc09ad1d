"""What comes from outside: heartbeats, facts, questions and answers, liveliness tokens.

Whatever is malformed or of another run is counted and logged once per source, never fatal.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.commands import Commands, answer_body
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Reply
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    FromOutside,
    MessageReceived,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.membership.anti_entropy import Received
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.heartbeat import HeartbeatSchedule
from mrbt_mesh.core.membership.wire import (
    Beat,
    IncompatibleError,
    MessageKind,
    WireError,
    decode,
    encode,
)

# Members of an enumeration are slow to look up.
_BEAT = MessageKind.BEAT


class Inbound:
    """Takes in messages."""

    def __init__(
        self,
        context: Context,
        executor: Executor,
        duplicates: DuplicateIdCheck,
        schedule: HeartbeatSchedule,
        commands: Commands,
    ) -> None:
        self._context = context
        self._executor = executor
        self._duplicates = duplicates
        self._schedule = schedule
        self._commands = commands

    def take(self, event: FromOutside, now_us: int, is_planning: bool) -> None:
        """Take in one; `is_planning`: a plan is being made, until then facts stay as they are."""
        match event:
            case MessageReceived(kind, source, data):
                try:
                    if kind is _BEAT:
                        self._read_beat(source, data, now_us, is_planning)
                    elif source != self._context.me:
                        received = self._context.replica.receive(source, data, now_us)
                        self._take_in(source, received)
                except WireError as error:
                    self._refuse(source, error)
            case TokenChanged(robot, incarnation, held):
                self._context.membership.token(robot, incarnation, held)
            case QueryReceived(query, kind, data):
                self._query(query, kind, data, now_us)
            case AnswerReceived(peer, data):
                self._answer(peer, data, now_us)

    def _read_beat(self, source: str, data: bytes, now_us: int, is_planning: bool) -> None:
        context = self._context
        membership = context.membership
        read = context.config.engine.read_beat
        beat = read(source, data, context.replica.header, membership.is_news)
        joining, mine = context.joining, context.replica.incarnation
        starting = joining is not None and joining.first
        if source == context.me:
            reason = self._duplicates.heard(beat, mine, starting, context.facts.members)
            context.stop(2, reason)
            return
        known = membership.peers.get(source)
        if membership.beat(source, beat, now_us):
            if known is None or known.incarnation != beat.word.incarnation:
                incarnation = str(beat.word.incarnation)
                context.log("info", "robot_heard", robot=source, incarnation=incarnation)
            context.replica.compare(source, beat.fact_digest, now_us)
            # Every beat says it again.
            if (beat.seeks is not None or beat.grants) and not is_planning:
                self._executor.lease_asked(source, beat, now_us)
            if beat.accusations and membership.is_asked(beat, mine):
                self._schedule.hurry(membership.present, now_us)
        if joining is not None:
            joining.heard(source)
        self._check_relays(source, beat, starting, now_us)

    def _check_relays(self, source: str, beat: Beat, starting: bool, now_us: int) -> None:
        context = self._context
        mine, members = context.replica.incarnation, context.facts.members
        reason = self._duplicates.relayed(source, beat, mine, starting, members, now_us)
        context.stop(2, reason)

    def _query(self, query: int, kind: MessageKind, data: bytes, now_us: int) -> None:
        context = self._context
        header = context.replica.header
        try:
            if kind is MessageKind.PULL:
                pages = context.replica.answer(data)
            else:
                _, body = decode(data, header, MessageKind.COMMAND)
                good, text = self._commands.carry_out(body, now_us)
                pages = (encode(header, MessageKind.ANSWER, answer_body(good, text)),)
            context.emit(Reply(query, pages))
        except WireError as error:
            answer = encode(header, MessageKind.ANSWER, answer_body(False, str(error)))
            context.emit(Reply(query, (answer,)))
            self._refuse("a query", error)

    def _answer(self, peer: str, data: bytes | None, now_us: int) -> None:
        context = self._context
        if data is None:
            context.replica.unanswered(peer, now_us)
            return
        try:
            received = context.replica.receive_state(data, now_us)
        except WireError as error:
            self._refuse(peer, error)
            return
        self._take_in(peer, received)
        if not received.more:
            context.replica.answered(peer)
            if context.joining is not None:
                context.joining.exchanged(peer)

    def _take_in(self, source: str, received: Received) -> None:
        if received.changed:
            self._context.keep(received.changed)
        if received.refused:
            self._context.refuse(source, received.reason)

    def _refuse(self, source: str, error: WireError) -> None:
        self._context.refuse(source, str(error), isinstance(error, IncompatibleError))
