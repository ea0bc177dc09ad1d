"""Messages from outside: heartbeats, facts, queries and answers, liveliness tokens.

A message that is malformed or belongs to another run is counted, and logged once per source and
reason. It is never fatal.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.commands import Commands
from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import AskRouter, Reply
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    FromOutside,
    MessageReceived,
    QueryReceived,
    RouterAnswered,
    TokenChanged,
)
from mrbt_mesh.core.agent.parts import Parts
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.envelope import RefusedError, StaleError
from mrbt_mesh.core.membership.replica import Received
from mrbt_mesh.core.membership.signed_reports import joined_report
from mrbt_mesh.core.membership.timing import HeartbeatSchedule
from mrbt_mesh.core.membership.wire import (
    DIGEST_BYTES,
    Heartbeat,
    IncompatibleError,
    MessageKind,
    SelfReport,
    WireError,
    decode,
)

# Members of an enumeration are slow to look up.
_BEAT = MessageKind.HEARTBEAT


class Inbound:
    """Processes messages."""

    def __init__(
        self,
        context: Context,
        duplicates: DuplicateIdCheck,
        schedule: HeartbeatSchedule,
        commands: Commands,
        parts: Parts,
    ) -> None:
        self._context = context
        self._duplicates = duplicates
        self._schedule = schedule
        self._commands = commands
        self._parts = parts

    def take(self, event: FromOutside, now_us: int) -> None:
        """Process one message."""
        sealing = self._context.sealing
        if sealing is not None:
            try:
                event = sealing.open(event)
            except WireError as error:
                self._not_authentic(event, error, now_us)
                return
        match event:
            case MessageReceived(kind, source, data):
                try:
                    if kind is _BEAT:
                        arrived_us = event.arrived_us
                        at_us = now_us if arrived_us is None else arrived_us
                        self._read_beat(source, data, at_us)
                    elif source != self._context.me:
                        self._read_facts(source, data, now_us)
                except WireError as error:
                    self._refuse(source, error)
            case TokenChanged(robot, incarnation, held, router):
                if self._context.membership.receive_token(robot, incarnation, held, router):
                    self._context.emit(AskRouter(robot, incarnation, router))
            case RouterAnswered(robot, incarnation, is_linked):
                self._context.membership.router_answered(robot, incarnation, is_linked)
            case QueryReceived(query, kind, data):
                self._query(query, kind, data, now_us)
            case AnswerReceived(peer, data):
                self._answer(peer, data, now_us)

    def _not_authentic(self, event: FromOutside, error: WireError, now_us: int) -> None:
        """Refuse a message. An operator without a key of this team gets an answer."""
        match event:
            case MessageReceived(_, source, _):
                self._refuse(source, error)
            case AnswerReceived(peer, _):
                if isinstance(error, RefusedError):
                    self._context.log("warning", "query_refused", peer=peer, reason=str(error))
                else:
                    self._refuse(peer, error)
                self._context.replica.anti_entropy.mark_unanswered(peer, now_us)
            case QueryReceived(query, kind, _):
                if isinstance(error, StaleError):
                    self._context.emit(Reply(query, (error.content,)))
                elif kind is MessageKind.COMMAND:
                    self._context.answer(query, False, f"{self._context.me} refuses this: {error}")
                else:
                    self._context.emit(Reply(query, ()))
                self._refuse("a query", error)

    def _read_beat(self, source: str, data: bytes, now_us: int) -> None:
        context = self._context
        membership = context.membership
        read = context.config.engine.read_heartbeat
        beat = read(source, data, context.replica.header, membership.is_new_relay)
        joining, mine = context.joining, context.replica.incarnation
        starting = joining is not None and joining.is_first
        if source == context.me:
            reason = self._duplicates.check_own_heartbeat(
                beat, mine, starting, context.facts.members
            )
            context.stop(2, reason)
            return
        known = membership.peers.get(source)
        if membership.receive_heartbeat(source, beat, now_us):
            self._refuse_false_relays(source)
            if known is None or known.incarnation != beat.report.incarnation:
                incarnation = str(beat.report.incarnation)
                context.log("info", "robot_heard", robot=source, incarnation=incarnation)
            self._compare_digest(source, beat, now_us)
            if beat.steady_us is not None:
                self._compare_clock(source, beat.report.incarnation.nonce, beat.steady_us, now_us)
            for heard in self._parts.heard:
                heard(source, beat, now_us)
            if beat.suspicions and membership.can_answer_probe(beat, mine):
                self._schedule.speed_up(membership.present_count, now_us)
        if joining is not None:
            joining.mark_heard(source)
        members = context.facts.members
        reason = self._duplicates.check_relays(source, beat, mine, starting, members, now_us)
        context.stop(2, reason)

    def _compare_digest(self, source: str, beat: Heartbeat, now_us: int) -> None:
        """Compare digests: of the facts and, once both have joined, of the members."""
        context = self._context
        theirs = ours = bytes(DIGEST_BYTES)
        if context.has_place and beat.report.has_joined:
            theirs, ours = beat.members_digest, context.members_digest()
        mine = context.facts.map.digest() + ours
        context.replica.compare_digest(source, beat.fact_digest + theirs, now_us, mine)

    def _compare_clock(self, source: str, process: str, shows_us: int, now_us: int) -> None:
        clocks, limit_us = self._context.peer_clocks, self._context.config.timing.detection_us
        is_first = clocks.is_calm(source, now_us - limit_us)
        if clocks.heard(source, process, shows_us, now_us) and is_first:
            self._context.log("warning", "clock_stood_still", peer=source)

    def _query(self, query: int, kind: MessageKind, data: bytes, now_us: int) -> None:
        replica = self._context.replica
        try:
            if kind is MessageKind.PULL:
                self._context.emit(Reply(query, replica.answer_pull(data, self._view)))
            else:
                _, body = decode(data, replica.header, MessageKind.COMMAND)
                answer = self._commands.carry_out(body, now_us)
                if isinstance(answer, AwaitedAnswer):
                    self._context.commands_on_disk.wait(query, answer)
                    self._context.answer_kept()
                else:
                    self._context.answer(query, *answer)
        except WireError as error:
            self._context.answer(query, False, str(error))
            self._refuse("a query", error)

    def _view(self, members_digest: bytes) -> dict[str, SelfReport]:
        """The healthy robots' reports, for a peer with other members; none while joining."""
        context = self._context
        incarnation = context.replica.incarnation
        same = context.membership.around.members_digest(incarnation) == members_digest
        if context.joining is not None or same:
            return {}
        mine = SelfReport(incarnation, 0, bytes(DIGEST_BYTES), True, 0)
        return context.membership.view(mine)

    def _answer(self, peer: str, data: bytes | None, now_us: int) -> None:
        context = self._context
        if data is None:
            context.replica.anti_entropy.mark_unanswered(peer, now_us)
            return
        try:
            received = context.replica.receive_state(peer, data, now_us)
        except WireError as error:
            self._refuse(peer, error)
            return
        self.take_in(peer, received)
        if received.view:
            members = context.facts.members.items()
            lives = {robot: each.incarnation for robot, each in members}
            context.membership.compare_view(peer, received.view, lives, now_us)
            self._refuse_false_relays(peer)
        if not received.has_more:
            context.replica.anti_entropy.mark_answered(peer, now_us)
            if context.joining is not None:
                context.joining.mark_answered(peer)

    def take_in(self, source: str, received: Received) -> None:
        """Have the journal keep what was news, and count what was refused."""
        context = self._context
        context.keep(received.changed)
        if received.refused:
            context.refuse(source, received.reason)

    def _read_facts(self, source: str, data: bytes, now_us: int) -> None:
        received = self._context.replica.receive(source, data, now_us)
        self.take_in(source, received)
        for entry in received.changed:
            if entry.name == records.MEMBER and entry.author == source:
                report = joined_report(entry.version.incarnation)
                self._context.membership.receive_join(source, report, now_us)

    def _refuse_false_relays(self, source: str) -> None:
        for robot in self._context.membership.false_relays:
            self._context.refuse(source, f"relays a report that {robot} has not signed")

    def _refuse(self, source: str, error: WireError) -> None:
        self._context.refuse(source, str(error), isinstance(error, IncompatibleError))
