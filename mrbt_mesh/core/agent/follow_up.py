"""What follows from an input and from the time, and a dirty check that mostly nothing does.

Everything is brought up to date in one order: who is alive, this robot's place in the team, the
plan, its own line of the plan, what the others must hear. Most heartbeats change nothing that any
of it follows from; to go through it after each would take a robot of a large team most of its time.
"""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.heartbeats import Heartbeats
from mrbt_mesh.core.agent.inputs import (
    Input,
    MessageReceived,
    NetworkInput,
    PositionReported,
    ProgressReported,
    TimerFired,
    TreeTicked,
)
from mrbt_mesh.core.agent.lifecycle import Lifecycle
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.timing import NEVER_US

# What robots and operators ask for always has its answer.
_MAY_CHANGE_NOTHING = (
    MessageReceived,
    PositionReported,
    ProgressReported,
    TimerFired,
    TreeTicked,
)


class FollowUp:
    """Does what is due.

    `step_us` is when time alone asks for more than news of others, questions and heartbeats, each
    of which is due where it is kept. `_seen` is what the last step went by, None if the next input
    has to be followed up whatever it is; `_reads_reports`: what others report is a part of it, as
    for who waits to start, or to stop.
    """

    def __init__(
        self,
        context: Context,
        planner: Planner,
        executor: Executor,
        reports: Reports,
        lifecycle: Lifecycle,
        heartbeats: Heartbeats,
        duplicates: DuplicateIdCheck,
        now_us: int,
    ) -> None:
        self._context = context
        self._planner = planner
        self._executor = executor
        self._reports = reports
        self._lifecycle = lifecycle
        self._heartbeats = heartbeats
        self._duplicates = duplicates
        self.step_us = now_us
        self._seen: int | None = None
        self._reads_reports = False
        # Until when others that join are waited for, None if nobody does.
        self._joining_until_us: int | None = None
        self._most_joined = 0
        # When the last plan was made, and before when none is made, None if one may be.
        self._planned_us = now_us
        self._plans_at_us: int | None = None

    def inputs(self, events: Sequence[Input], now_us: int) -> None:
        """These have been taken in: do what follows from them."""
        if self._planner.awaited is not None:
            self._judge(now_us)
            self._ask_who_is_due(now_us)
            self._heartbeats.send_if_due(now_us)
        elif not self._is_clean(events, now_us):
            self._bring_up_to_date(events, now_us)
            self._note_what_is_done(now_us)
        else:
            if now_us >= self._context.replica.anti_entropy.next_ask_us:
                self._ask_who_is_due(now_us)
            self._heartbeats.send_if_regular(now_us)

    # -- everything ---------------------------------------------------------------------------

    def _bring_up_to_date(self, events: Sequence[Input], now_us: int) -> None:
        context, executor = self._context, self._executor
        self._judge(now_us)
        if self._lifecycle.step(now_us):
            self._reports.say_what_was_kept(now_us)
        if context.joining is None:
            executor.check_leases(now_us)
            self._reports.contradict(now_us)
            # Leases may have to be renewed while a plan is made elsewhere, and they are facts.
            apart = context.config.plans_apart and executor.leases.is_idle
            awaits_others = self._awaits_joining(now_us) or self._awaits_news(events, now_us)
            if not awaits_others:
                if not self._planner.is_current:
                    self._planned_us = now_us
                self._planner.update(now_us, apart)
            if self._planner.awaited is None and not awaits_others:
                self._reports.ask_for_bids()
                executor.perform(now_us)
        self._ask_who_is_due(now_us)
        result = None
        if self._planner.awaited is None:
            result = self._lifecycle.result_to_stop_with(now_us)
        if result is not None:
            self._heartbeats.send(now_us)
            context.stop(0 if result is Status.SUCCESS else 1, f"mission {result.name.lower()}")
        if context.is_leaving and context.work.is_idle:
            self._heartbeats.send(now_us)
            context.stop(0, "left")
        else:
            self._heartbeats.send_if_due(now_us)

    def _awaits_joining(self, now_us: int) -> bool:
        """Whether a plan would be too early, while others are about to join.

        Each of them changes the plan, and nobody begins before they have it too. They are waited
        for no longer than agreement is, from the last one that did.
        """
        membership = self._context.membership
        if not membership.around.newcomers:
            self._joining_until_us = None
        elif self._joining_until_us is None or membership.joined_count > self._most_joined:
            self._most_joined = membership.joined_count
            self._joining_until_us = now_us + self._context.config.timing.grace_us
        return self._joining_until_us is not None and now_us < self._joining_until_us

    def _awaits_news(self, events: Sequence[Input], now_us: int) -> bool:
        """Whether a plan would be too early, right after another one.

        Where many begin at once each of them changes the plan of all. What the robot itself says
        is followed up at once: it is a step of the tree.
        """
        self._plans_at_us = None
        are_from_network = all(isinstance(event, NetworkInput | TimerFired) for event in events)
        if self._planner.is_current or not are_from_network:
            return False
        earliest_us = self._planned_us + self._context.membership.around.plan_spacing_us
        if now_us < earliest_us:
            self._plans_at_us = earliest_us
        return now_us < earliest_us

    def _judge(self, now_us: int) -> None:
        context = self._context
        if not context.membership.needs_detection(now_us):
            return
        for robot, before, after in context.membership.detect_failures(now_us):
            level = "warning" if after.is_suspected else "info"
            context.log(level, f"robot_{after}", robot=robot, before=str(before))
            if not after.is_member:
                context.replica.anti_entropy.forget(robot)
        self._heartbeats.hurry_if_probing(now_us)

    def _ask_who_is_due(self, now_us: int) -> None:
        peers = self._context.replica.anti_entropy.peers_to_ask(now_us)
        if peers:
            self._context.ask(peers, now_us)

    # -- the dirty check ----------------------------------------------------------------------

    def _is_clean(self, events: Sequence[Input], now_us: int) -> bool:
        """Whether nothing follows from inputs. So it is with most."""
        return (
            now_us < self.step_us
            and self._seen == self._changes()
            and all(isinstance(event, _MAY_CHANGE_NOTHING) for event in events)
            and not self._context.membership.needs_detection(now_us)
        )

    def _changes(self) -> int:
        """Grows with all that a message can change and that something follows from."""
        membership = self._context.membership
        changes = (
            self._context.facts.changes + membership.member_changes + membership.suspicion_changes
        )
        changes += membership.around.broadcast_generation + self._duplicates.changes
        return changes + membership.report_changes if self._reads_reports else changes

    def _note_what_is_done(self, now_us: int) -> None:
        """Until something changes, or a deadline passes, nothing more follows."""
        context, planner, leases = self._context, self._planner, self._executor.leases
        joining, done_us = context.joining, self._lifecycle.done_us
        is_waiting = context.work.is_waiting
        deadlines_us = (
            planner.deadlines.next_deadline_us(),
            leases.next_deadline_us(),
            self._joining_until_us,
            self._plans_at_us,
            joining.deadline_us if joining is not None else None,
            joining.gathers_until_us if joining is not None else None,
            joining.yields_until_us if joining is not None else None,
            self._executor.grace_ends_us if is_waiting else None,
            done_us + context.config.timing.heartbeat_us if done_us is not None else None,
        )
        ahead_us = [at for at in deadlines_us if at is not None and at > now_us]
        self.step_us = min(ahead_us, default=NEVER_US)
        self._seen = None
        if self._executor.shows_outcome:
            return
        if joining is None and leases.is_idle and planner.is_current:
            awaits_reports = is_waiting or planner.deadlines.awaits_agreement
            self._reads_reports = done_us is not None or awaits_reports or self._lifecycle.is_over
            self._seen = self._changes()
