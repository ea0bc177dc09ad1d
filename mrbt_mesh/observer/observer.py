"""A passive replica: it receives the team's messages, sends none, and keeps the run's record.

`mrbt up`, `mrbt status` and the simulator use the same class, so they agree. No robot waits for it,
since it sends no heartbeats.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.engine import FASTEST, Engine
from mrbt_mesh.core.facts.records import Claim, TeamOrder
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.replica import Replica
from mrbt_mesh.core.membership.signed_reports import SignedReports
from mrbt_mesh.core.membership.timing import Timing, earlier_median
from mrbt_mesh.core.membership.wire import (
    Header,
    Heartbeat,
    IncompatibleError,
    MessageKind,
    WireError,
)
from mrbt_mesh.core.mission.mission import Mission, MissionEnd
from mrbt_mesh.core.planning.derived_facts import DerivedFacts
from mrbt_mesh.core.planning.outcome_tick import shown_by_tick
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.observer.idle import why_idle
from mrbt_mesh.observer.run_record import RunRecord


@dataclass(frozen=True, slots=True)
class RunEnd:
    """The run has ended without its mission's result, as its files say: how and why, and since when
    that is known. It may be continued.
    """

    result: str
    because: str
    at_us: int


class Observer:
    """Feed it messages and tokens with the time of their arrival, then read it.

    `update` brings plan and record up to date; call it after a burst of messages and at least once
    per heartbeat period.
    """

    def __init__(
        self,
        mission: Mission,
        run: str,
        timing: Timing,
        solver: Solver,
        engine: Engine = FASTEST,
        keys: Keys | None = None,
        limit: int | None = None,
    ) -> None:
        """`limit`: see `RunRecord`."""
        self.facts = TeamFacts(mission, run)
        header = Header(mission.team_digest[:16], mission.name, run, "")
        self.replica = Replica(self.facts, header, timing, "", engine.read_batch, keys)
        self.replica.shown_by_tick = partial(shown_by_tick, self.facts)
        self.membership = Membership("", timing, reports=SignedReports(keys, run))
        self.record = RunRecord(mission, limit, self.clock_ahead_us)
        self.plan: Plan | None = None
        # How many times faster than the mission says simulated robots work; for people alone.
        self.speed = 1.0
        self.refused: dict[str, str] = {}
        # Robots whose processes are known to run, though they may not be heard.
        self.running: frozenset[str] = frozenset()
        self.ended: RunEnd | None = None
        self._make_plan = engine.plan_making(solver)
        self._engine = engine
        self._planned: tuple[int, int] = (-1, -1)
        self._updated: tuple[int, int, int] = (-1, -1, -1)
        self._recorded: tuple[Plan | None, bool] = (None, False)
        self._idle: tuple[Plan | None, Mapping[str, str]] = (None, {})
        self._has_caught_up = False
        self._first_heard_us: int | None = None

    @property
    def mission(self) -> Mission:
        """The mission in force, as its file has it."""
        return self.facts.in_force

    def begin_with(self, mission: Mission) -> None:
        """What it is about to be told begins with another mission of the same team: the first one,
        or another revision. Nothing is known yet.
        """
        self.facts.begin_with(mission)
        self.record.use(mission)

    def watch_from(self, now_us: int, until_us: int) -> None:
        """The messages so far are of a time until `until_us`; from now on it hears the team.

        Robots of that time need not live any more, so each has to be heard again.
        """
        before = self.membership
        self.membership = Membership("", before.timing, reports=before.reports)
        self._planned, self._updated = (-1, -1), (-1, -1, -1)
        self._recorded, self._has_caught_up = (None, False), False
        self._first_heard_us = None
        self.record.watched_from(now_us, until_us)

    def message(self, kind: MessageKind, source: str, data: bytes, now_us: int) -> None:
        """A published heartbeat or batch; malformed or foreign ones are noted in `refused`."""
        try:
            if kind is MessageKind.HEARTBEAT:
                read, header = self._engine.read_heartbeat, self.replica.header
                beat = read(source, data, header, self.membership.is_new_relay)
                self._beat(source, beat, now_us)
            else:
                self.facts_changed(self.replica.receive(source, data, now_us).changed, now_us)
        except WireError as error:
            self._refuse(source, error, now_us)

    def state(self, source: str, data: bytes, now_us: int) -> None:
        """A robot's answer to `replica.pull()`."""
        try:
            received = self.replica.receive_state(source, data, now_us)
            self.facts_changed(received.changed, now_us)
            if not received.has_more:
                self.replica.anti_entropy.mark_answered(source, now_us)
        except WireError as error:
            self._refuse(source, error, now_us)

    def read(self, entries: Iterable[Entry], now_us: int) -> None:
        """Take in the journals of robots that no longer run to report the result."""
        by_age = sorted(entries, key=lambda entry: (entry.version.sequence, entry.author))
        changed = self.replica.restore(by_age)
        if changed and self.record.started_us is None:
            self.record.started_us = now_us
        self.facts_changed(changed, now_us)
        self.update(now_us)
        self._result_of_plan(now_us)

    def follow(self, plan: Plan, now_us: int, settled: bool) -> None:
        """Take over a plan of the facts that was made elsewhere, and record what follows."""
        self.plan, self._recorded = plan, (plan, settled)
        self.record.plan(plan, now_us, settled)
        self._result_of_plan(now_us)
        if self._has_work:
            self.record.round_runs(now_us)

    def _refuse(self, source: str, error: WireError, now_us: int) -> None:
        """The record says once that it is the wrong run, or another mission file."""
        if isinstance(error, IncompatibleError) and source not in self.refused:
            self.record.say(now_us, f"{source} is not of this run: {error}")
        self.refused[source] = str(error)

    def _beat(self, source: str, beat: Heartbeat, now_us: int) -> None:
        if self._first_heard_us is None:
            self._first_heard_us = now_us
            if beat.report.has_joined and not self.record.is_catching_up:
                self.record.watched_from(now_us, None)  # its team was there before
        if not self.membership.receive_heartbeat(source, beat, now_us):
            return
        self.replica.compare_digest(source, beat.fact_digest, now_us)
        if beat.report.has_joined:
            self.record.robot_seen(source, beat.report.incarnation, now_us)
            self.record.work_log.goes_on(source, beat.work_ms, now_us)
            for suspicion in beat.suspicions:
                if suspicion.is_dead:
                    self.record.declared_dead(suspicion.robot, suspicion.incarnation, now_us)

    def facts_changed(self, changed: Iterable[Entry], now_us: int) -> None:
        """Record these entries, which have changed in the fact map."""
        if self.mission is not self.record.mission:
            self.record.revised(self.mission, now_us)
        for entry in changed:
            self.record.fact(entry, now_us)

    def update(self, now_us: int) -> None:
        """Detect failures, plan if anything changed, and record both."""
        for robot, _, after in self.membership.detect_failures(now_us):
            evidence_us = self.membership.peers[robot].last_heard_us
            self.record.state(robot, after, evidence_us, now_us)
        heard_us = self._first_heard_us
        if heard_us is not None and now_us - heard_us > self.membership.timing.detection_us:
            self.record.missed(now_us)  # every living robot is heard within that time
        self._take_back(now_us)
        facts, membership = self.facts, self.membership
        self.replica.follow_keys(membership.members())
        state = (facts.changes, membership.member_changes, membership.report_changes)
        if state == self._updated and self._has_caught_up and not self.replica.unproved:
            return  # nothing has changed that follows below
        facts.prune()
        self._updated = (facts.changes, membership.member_changes, membership.report_changes)
        changes = (facts.changes, membership.member_changes)
        if changes != self._planned:
            self._planned = changes
            alive = self.membership.members()
            self.plan = self._make_plan(self.facts, alive)
        if self._take_shown(now_us):
            self.update(now_us)
            return
        if self.plan is not None:
            settled = self._is_settled(self.plan)
            if self._recorded[0] is not self.plan or self._recorded[1] is not settled:
                self._recorded = (self.plan, settled)
                self.record.plan(self.plan, now_us, settled)
        result = self.team_result
        if result is not None:
            self._ended(result, now_us)
        elif self._has_work:
            self.record.round_runs(now_us)

    def _take_back(self, now_us: int) -> None:
        """Robots that were silent, or that others held for dead, and that all hear again."""
        peers = self.membership.peers
        for robot in self.record.in_doubt():
            peer = peers.get(robot)
            if peer is None or not peer.state.is_healthy:
                continue
            if peer.report.has_joined:
                # A later life, of which others have told before its own heartbeat came.
                self.record.robot_seen(robot, peer.incarnation, now_us)
            accused = {
                suspicion.incarnation
                for other in peers.values()
                if other.state.is_healthy and other.heartbeat is not None
                for suspicion in other.heartbeat.suspicions
                if suspicion.robot == robot
            }
            if peer.incarnation not in accused:
                self.record.heard_again(robot, peer.incarnation, peer.last_heard_us, now_us)

    def _take_shown(self, now_us: int) -> bool:
        """Take in what follows from the facts by the word of robots; whether there was any."""
        plan = self.plan
        if not self.replica.unproved or plan is None:
            return False
        alive = self.membership.members()
        derived = DerivedFacts(self.facts, plan.evaluation, alive)
        changed = self.replica.take_shown(derived.show, self.membership, now_us)
        self.facts_changed(changed, now_us)
        return bool(changed)

    @property
    def is_over(self) -> bool:
        """Whether the run is: by the team's result, or since no robot of it is left."""
        return self.record.result is not None or self.ended is not None

    @property
    def _stands_by(self) -> bool:
        """Whether the team goes on when T_G has ended; after an abort none does."""
        return self.mission.ends is MissionEnd.NEVER and self.facts.order() is not TeamOrder.ABORT

    @property
    def _has_work(self) -> bool:
        """Whether the team no longer stands by: T_G is Running in the plan that it agrees on."""
        is_running = self.plan is not None and self.plan.result is Status.RUNNING
        return self._stands_by and is_running and self._recorded[1]

    def _result_of_plan(self, now_us: int) -> None:
        """Believe the plan, whatever robots report."""
        plan = self.plan
        if plan is None or not (plan.is_final or self._stands_by):
            return
        if plan.result in (Status.SUCCESS, Status.FAILURE):
            self._ended(plan.result, now_us)

    def _ended(self, result: Status, now_us: int) -> None:
        """The team has come to a result. Its reports may be older than this observer's plan."""
        if not self._stands_by:
            self.record.over(result, now_us)
        elif self.plan is not None and self.plan.result is result:
            self.record.round_over(result, now_us)

    def _is_settled(self, plan: Plan) -> bool:
        """Whether this plan is the team's: no robot is joining or waits for capabilities of its
        own, and a robot reports the same.

        An observer that comes late has an outdated view of the team until it has caught up.
        """
        self._has_caught_up = self._has_caught_up or self.caught_up
        self.record.is_catching_up &= not self._has_caught_up
        if not self._has_caught_up:
            return False
        alive = {r: p for r, p in self.membership.peers.items() if p.state.is_healthy}
        good, members = alive.values(), self.facts.members
        if any(members[r].member.pending for r in alive if r in members):
            return False
        return all(p.report.has_joined for p in good) and any(
            p.report.plan_digest == plan.digest for p in good
        )

    @property
    def team_result(self) -> Status | None:
        """SUCCESS or FAILURE once every robot of the alive set reports it, else None.

        Of a mission that ends, once that is a fact: until then a condition may turn.
        """
        alive, plan = self.membership.members(), self.plan
        for result in (Status.SUCCESS, Status.FAILURE):
            if alive and self.membership.all_report_result(int(result)):
                has_ended = plan is not None and plan.is_final and plan.result is result
                return result if has_ended or self._stands_by else None
        return None

    def result(self, anybody_lives: bool) -> str:
        """The run's result as reports name it, if it ends now: `success` or `failure`.

        Else `not_started`: its team had not gathered, so no robot had joined. `blocked`: robots
        are missing, or all of them. `timeout`: the mission was on its way. Where it never ends, the
        result of its last round that has ended, unless the team is blocked.
        """
        if self.record.result is not None:
            return self.record.result.name.lower()
        if self.record.started_us is None:
            return "not_started"
        is_blocked = any(episode.to_us is None for episode in self.record.blocked)
        if is_blocked or not anybody_lives:
            return "blocked"
        standing = self.record.rounds.result
        return "timeout" if standing is None else standing.name.lower()

    def clock_ahead_us(self) -> int | None:
        """By how much the team's wall clocks are ahead of the observer's; None: not known."""
        offsets_us = self.membership.clock_offsets_us()
        return earlier_median(offsets_us) if offsets_us else None

    @property
    def caught_up(self) -> bool:
        """Whether it hears all living robots, and holds the same facts."""
        peers = self.membership.peers.values()
        beats = [p.heartbeat for p in peers if p.report.has_joined and p.state.is_healthy]
        digest = self.facts.map.digest()
        return bool(beats) and all(b is not None and b.fact_digest == digest for b in beats)

    @property
    def agreement(self) -> bool:
        """Whether all robots in good standing report the same plan digest."""
        digests = {
            peer.report.plan_digest
            for peer in self.membership.peers.values()
            if peer.report.has_joined and peer.state.is_healthy
        }
        return len(digests) <= 1

    @property
    def idle(self) -> Mapping[str, str]:
        """Robot -> why the plan assigns nothing to it."""
        plan = self.plan
        if plan is not None and self._idle[0] is not plan:
            self._idle = plan, why_idle(plan, self.facts, self.membership.members())
        return self._idle[1] if plan is not None else {}

    def claim(self, robot: str) -> Claim | None:
        """What a living robot works on."""
        peer = self.membership.peers.get(robot)
        held = self.facts.claims.get(robot)
        if peer is None or held is None or held[1] != peer.incarnation:
            return None
        return held[0] if peer.state.is_member else None

    def robot_state(self, robot: str) -> State:
        """ALIVE, SUSPECT, DEAD or LEFT; a robot known only from facts is dead or has left. One that
        a revision has removed is not dead, nor is one whose process runs while no other robot has
        declared it dead.
        """
        peer = self.membership.peers.get(robot)
        member = self.facts.members.get(robot)
        left = member is not None and member[0].is_leaving
        if left and member and (peer is None or peer.incarnation == member[1]):
            return State.LEFT
        state = peer.state if peer is not None else State.DEAD
        if state is State.DEAD and robot in self.facts.removed_robots:
            return State.LEFT
        if state is State.DEAD and robot in self.running and not self.record.is_declared(robot):
            return State.SUSPECT
        return state

    def robots(self) -> list[str]:
        """All robots that are known, sorted."""
        return sorted({*self.facts.members, *self.membership.peers, *self.running})
