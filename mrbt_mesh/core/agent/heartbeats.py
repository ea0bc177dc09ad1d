"""What a robot says of itself in every beat, and when it beats."""

from __future__ import annotations

from typing import NamedTuple

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Publish
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.membership.heartbeat import HeartbeatSchedule
from mrbt_mesh.core.membership.wire import Heartbeat, MessageKind, SelfReport, Suspicion


class Urgent(NamedTuple):
    """What the others must hear at once when it changes."""

    digest: bytes
    result: Status
    accusations: tuple[Suspicion, ...]
    is_joined: bool
    is_leaving: bool
    sought: tuple[str, str] | None
    granted: tuple[tuple[str, str], ...]


class Heartbeats:
    """Puts this robot's beats together."""

    def __init__(
        self,
        context: Context,
        schedule: HeartbeatSchedule,
        planner: Planner,
        executor: Executor,
    ) -> None:
        self._context = context
        self._schedule = schedule
        self._planner = planner
        self._executor = executor

    def send_if_due(self, now_us: int) -> None:
        """Beat if it is time, or if there is something that others must hear at once."""
        urgent = self._urgent()
        if self._schedule.is_due(urgent, now_us):
            self._send(urgent, now_us)

    def send_if_regular(self, now_us: int) -> None:
        """Beat if it is time; nothing has changed that others must hear at once."""
        if now_us >= self._schedule.next_due_us:
            self.hurry_if_probing(now_us)
            self._send(self._urgent(), now_us)

    def send(self, now_us: int) -> None:
        """Beat now."""
        self._send(self._urgent(), now_us)

    def hurry_if_probing(self, now_us: int) -> None:
        """Beat faster while this robot asks for news of another one."""
        membership = self._context.membership
        if membership.is_probing:
            self._schedule.speed_up(membership.live_peer_count, now_us)

    def _urgent(self) -> Urgent:
        context, plan, leases = self._context, self._planner.plan, self._executor.leases
        digest, result = (plan.digest, plan.result) if plan else (b"", Status.RUNNING)
        granted = tuple([(grant.coalition, grant.member) for grant in leases.grantor.grants()])
        accusations = context.membership.suspicions()
        is_joined, is_leaving = context.joining is None, context.is_leaving
        return Urgent(
            digest, result, accusations, is_joined, is_leaving, leases.holder.requested, granted
        )

    def _send(self, urgent: Urgent, now_us: int) -> None:
        context, plan, executor = self._context, self._planner.plan, self._executor
        number = self._schedule.mark_sent(urgent, now_us)
        # A beat renews the leases that this robot holds: it answers itself first.
        granted = executor.leases.heartbeat_sent(number, now_us, executor.may_grant)
        if granted:
            context.write(granted, now_us)
        digest, result = (plan.digest, plan.result) if plan else (bytes(8), Status.RUNNING)
        is_joined, membership = urgent.is_joined, context.membership
        beat = Heartbeat(
            SelfReport(context.replica.incarnation, number, digest, is_joined, int(result)),
            context.is_leaving,
            context.facts.map.digest(),
            tuple([int(status) for status in executor.tree.statuses]),
            context.work.progress,
            urgent.accusations,
            membership.relays(),
            executor.leases.holder.requested,
            executor.leases.grantor.grants(),
        )
        data = context.config.engine.write_heartbeat(beat, context.replica.header)
        context.emit(Publish(MessageKind.HEARTBEAT, data))
