"""The agent: one robot of the team as a pure object. Inputs and time in, effects out.

`Agent.handle(input, now_us) -> list[fx.Effect]` and `Agent.next_deadline_us(now_us)` are all
there is; a runtime drives it with Zenoh and a real clock, the simulator with a faulty network
and a virtual one.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mrbt_mesh.core.agent import effects as fx
from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.commands import answer_body, carry_out
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.deferred_inputs import DeferredInputs
from mrbt_mesh.core.agent.description import Description
from mrbt_mesh.core.agent.dirty_check import DirtyCheck
from mrbt_mesh.core.agent.executor import check_grants, may_grant, perform, seek_grants
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.agent.refusals import Refusals
from mrbt_mesh.core.agent.reports import (
    ask_for_bids,
    bids_made,
    change_capability,
    finished,
    leave,
    set_conditions,
)
from mrbt_mesh.core.agent.work import Work
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.anti_entropy import Received, Replica
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.heartbeat import HeartbeatSchedule
from mrbt_mesh.core.membership.joining import Joining
from mrbt_mesh.core.membership.leases import Leases
from mrbt_mesh.core.membership.membership import Membership, State
from mrbt_mesh.core.membership.timing import NEVER_US
from mrbt_mesh.core.membership.wire import (
    Beat,
    Header,
    IncompatibleError,
    MessageKind,
    WireError,
    Word,
    decode,
    encode,
)
from mrbt_mesh.core.mission.mission import Mission, type_name
from mrbt_mesh.core.planning.plan import Plan

# Members of an enumeration are slow to look up.
_BEAT = MessageKind.BEAT
_RESULTS = (Status.SUCCESS, Status.FAILURE)
_FROM_OUTSIDE = (inputs.TokenChanged, inputs.QueryReceived, inputs.AnswerReceived)


class Agent:
    """One robot. Not thread-safe; every call takes the time from one monotonic clock."""

    def __init__(self, mission: Mission, config: AgentConfig, now_us: int) -> None:
        self.mission = mission
        self.config = config
        self.me = config.robot
        header = Header(mission.digest[:16], mission.name, config.run, config.robot)
        self.facts = TeamFacts(mission, config.run)
        self.replica = Replica(
            self.facts, header, config.timing, config.nonce, config.engine.read_batch
        )
        self.replica.restore(config.restored)
        self.membership = Membership(self.me, config.timing)
        self.gossip = HeartbeatSchedule(config.timing, now_us)
        self.joining: Joining | None = Joining(config.timing, config.expected - {self.me}, now_us)
        self.work = Work()
        self.tree = RobotTree({type_name(name) for name in config.capabilities})
        self.grants = Leases(self.me, self.facts, config.timing, now_us)
        self.planner = Planner(self.me, self.facts, config, self.tree)
        self.identity = DuplicateIdCheck(self.me, config.nonce, config.takeover, config.timing)
        self.description = Description(
            self.me, config.type, config.capabilities, config.software, config.host, config.pid
        )
        self.refusals = Refusals()
        # The (activation, local task) pairs for which this robot's program was asked to bid.
        self.asked_bids: set[tuple[str, str]] = set()
        self._effects: list[fx.Effect] = []
        self._deadline_us = now_us
        self.quiet = DirtyCheck(now_us)
        self.meanwhile = DeferredInputs()
        # Since when all report the mission's result.
        self.done_us: int | None = None
        # Conditions that a new life keeps until its incarnation is above all earlier ones.
        self.unsaid: dict[str, bool] = {}
        self._stopped = False

    # -- the two calls ------------------------------------------------------------------------

    def handle(self, event: inputs.Input, now_us: int) -> list[fx.Effect]:
        """Take in one input; returns what is to be done, in order."""
        if self._stopped:
            return []
        if now_us > self._deadline_us:
            self._catch_up(now_us)
        if self.config.plans_apart:
            for each in self.meanwhile.due(event, self.planner.is_busy):
                self._take(each, now_us)
        else:
            self._take(event, now_us)
        if not self._stopped:
            self._follow(event, now_us)
        effects, self._effects = self._effects, []
        return effects

    def _follow(self, event: inputs.Input, now_us: int) -> None:
        if self.planner.is_busy:
            self._judge(now_us)
            self._ask_who_is_due(now_us)
            if self.gossip.is_due(self._urgent(), now_us):
                self._beat_now(now_us)
        elif not self.quiet.lets_pass(self, event, now_us):
            self._settle(now_us)
            self.quiet.begin(self, now_us)
        else:
            if now_us >= self.replica.ask_us:
                self._ask_who_is_due(now_us)
            if now_us >= self.gossip.next_beat_us:
                self._hurry_if_seeking(now_us)
                self._beat_now(now_us)

    def _take(self, event: inputs.Input, now_us: int) -> None:
        if isinstance(event, inputs.MessageReceived):
            self._message(event.kind, event.source, event.data, now_us)
        elif isinstance(event, _FROM_OUTSIDE):
            self._from_outside(event, now_us)
        else:
            self._from_robot(event, now_us)

    def next_deadline_us(self, now_us: int) -> int:
        """When to call `handle(TimerFired())` at the latest, if nothing else happens."""
        step_us = self.quiet.step_us
        if self.config.plans_apart:
            if self.planner.is_busy:
                step_us = NEVER_US
            elif self.meanwhile.waits:
                step_us = now_us
        self._deadline_us = min(
            step_us,
            self.membership.at_peace_until_us,
            self.replica.ask_us,
            self.gossip.next_beat_us,
        )
        return self._deadline_us

    # -- inputs -------------------------------------------------------------------------------

    def _from_outside(
        self, event: inputs.TokenChanged | inputs.QueryReceived | inputs.AnswerReceived, now_us: int
    ) -> None:
        match event:
            case inputs.TokenChanged(robot, incarnation, held):
                self.membership.token(robot, incarnation, held)
            case inputs.QueryReceived(query, kind, data):
                self._query(query, kind, data, now_us)
            case inputs.AnswerReceived(peer, data):
                self._answer(peer, data, now_us)

    def _from_robot(self, event: inputs.Input, now_us: int) -> None:
        match event:
            case inputs.ActionFinished():
                finished(self, event, now_us)
            case inputs.ActionStopped(ticket):
                self.work.stopped(ticket)
            case inputs.ProgressReported(ticket, percent):
                if self.work.action is not None and self.work.action.number == ticket:
                    self.work.progress = max(0, min(100, percent))
            case inputs.ConditionSet(name, value):
                set_conditions(self, {name: value}, now_us)
            case inputs.CapabilityChanged(local_task, lost):
                change_capability(self, local_task, lost, now_us)
            case inputs.BidsMade():
                bids_made(self, event, now_us)
            case inputs.LeaveRequested():
                leave(self, now_us)
            case inputs.PlanMade(number, plan):
                if self.planner.is_busy and number == self.planner.number:
                    self.write(self.planner.made(plan), now_us)
            case _:
                pass  # TimerFired: what is due follows below

    def _message(self, kind: MessageKind, source: str, data: bytes, now_us: int) -> None:
        try:
            if kind is _BEAT:
                read, header = self.config.engine.read_beat, self.replica.header
                beat = read(source, data, header, self.membership.is_news)
                self._beat(source, beat, now_us)
            elif source != self.me:
                self._take_in(source, self.replica.receive(source, data, now_us))
        except WireError as error:
            self._refuse(source, str(error), isinstance(error, IncompatibleError))

    def _beat(self, source: str, beat: Beat, now_us: int) -> None:
        mine, members, joining = self.replica.incarnation, self.facts.members, self.joining
        starting = joining is not None and joining.first
        if source == self.me:
            self._stop(2, self.identity.heard(beat, mine, starting, members))
            return
        known = self.membership.peers.get(source)
        if self.membership.beat(source, beat, now_us):
            if known is None or known.incarnation != beat.word.incarnation:
                incarnation = str(beat.word.incarnation)
                self.log("info", "robot_heard", robot=source, incarnation=incarnation)
            self.replica.compare(source, beat.fact_digest, now_us)
            # Every beat says it again.
            if (beat.seeks is not None or beat.grants) and not self.planner.is_busy:
                self.write(self.grants.heard(source, beat, now_us, self._may_grant), now_us)
            if beat.accusations and self.membership.is_asked(beat, mine):
                self.gossip.hurry(self.membership.present, now_us)
        if joining is not None:
            joining.heard(source)
        reason = self.identity.relayed(source, beat, mine, starting, members, now_us)
        if reason is not None:
            self._stop(2, reason)

    def _query(self, query: int, kind: MessageKind, data: bytes, now_us: int) -> None:
        header = self.replica.header
        try:
            if kind is MessageKind.PULL:
                self._effects.append(fx.Reply(query, self.replica.answer(data)))
            else:
                _, body = decode(data, header, MessageKind.COMMAND)
                good, text = carry_out(self, body, now_us)
                answer = encode(header, MessageKind.ANSWER, answer_body(good, text))
                self._effects.append(fx.Reply(query, (answer,)))
        except WireError as error:
            answer = encode(header, MessageKind.ANSWER, answer_body(False, str(error)))
            self._effects.append(fx.Reply(query, (answer,)))
            self._refuse("a query", str(error), isinstance(error, IncompatibleError))

    def _answer(self, peer: str, data: bytes | None, now_us: int) -> None:
        if data is None:
            self.replica.unanswered(peer, now_us)
            return
        try:
            received = self.replica.receive_state(data, now_us)
        except WireError as error:
            self._refuse(peer, str(error), isinstance(error, IncompatibleError))
            return
        self._take_in(peer, received)
        if not received.more:
            self.replica.answered(peer)
            if self.joining is not None:
                self.joining.exchanged(peer)

    def _take_in(self, source: str, received: Received) -> None:
        if received.changed:
            self._effects.append(fx.Persist(tuple(received.changed), synced=False))
        if received.refused:
            self._refuse(source, received.reason)

    # -- what follows from it -----------------------------------------------------------------

    def _catch_up(self, now_us: int) -> None:
        """Self-fencing, and patience with others after this robot itself was slow.

        A deadline is never later than this robot's next beat.
        """
        lag_us = now_us - self._deadline_us
        if lag_us > self.config.timing.beat_us // 2:
            self.membership.slowed(lag_us, now_us)
        self._deadline_us = now_us
        silent_us = now_us - self.gossip.last_beat_us
        if silent_us > self.config.timing.fence_us and self.joining is None:
            self.log("warning", "fenced", silent_s=silent_us / 1e6)
            heard = self.replica.next_incarnation(0)
            self._effects.append(fx.DeclareToken(heard))
            self._join_again(frozenset(self.membership.alive()), False, now_us)
            # On disk before it is beaten out: no later process may take this incarnation again.
            self.write([(records.CLAIM, None)], now_us)

    def _check_own_past(self, now_us: int) -> None:
        """Find a later life of this robot in the facts, or others burying one: it started again
        without knowing of it.

        Others ignore its beats, so it joins once more, above that life. If that life still
        goes on, it is heard meanwhile, and this process stops: it listens for as long as it
        takes, because it expects itself, whom it never hears.
        """
        known = self.facts.members.get(self.me)
        later = max(self.identity.rival, known[1] if known is not None else self.identity.rival)
        if self.joining is None and later > self.replica.incarnation:
            self.log("warning", "later_life_found", incarnation=str(later))
            self._join_again(frozenset({self.me}), True, now_us)

    def _join_again(self, expected: frozenset[str], first: bool, now_us: int) -> None:
        self._effects += self.work.drop()
        self.joining = Joining(self.config.timing, expected, now_us, first)
        self.identity.restart()
        self.planner.forget()

    def _settle(self, now_us: int) -> None:
        """Bring everything that follows from facts and time up to date."""
        self._judge(now_us)
        self._check_own_past(now_us)
        if self.joining is not None and not self.leaving:
            self._try_to_join(now_us)
        if self.joining is None:
            check_grants(self, now_us)
            self._replan(now_us)
            if not self.planner.is_busy:
                ask_for_bids(self)
                perform(self, now_us)
                seek_grants(self)
        self._ask_who_is_due(now_us)
        if not self.planner.is_busy:
            self._finish_mission(now_us)
        if self.leaving and self.work.is_idle:
            self._beat_now(now_us)
            self._stop(0, "left")
        elif self.gossip.is_due(self._urgent(), now_us):
            self._beat_now(now_us)

    def _judge(self, now_us: int) -> None:
        for robot, before, after in self.membership.judge(now_us):
            level = "warning" if after in (State.DEAD, State.SUSPECT) else "info"
            self.log(level, f"robot_{after}", robot=robot, before=str(before))
            if after in (State.DEAD, State.LEFT):
                self.replica.forget(robot)
        self._hurry_if_seeking(now_us)

    def _hurry_if_seeking(self, now_us: int) -> None:
        if self.membership.is_seeking:
            self.gossip.hurry(self.membership.present, now_us)

    def _try_to_join(self, now_us: int) -> None:
        assert self.joining is not None
        wanted = self.joining.wanted(self.membership.peers, self.facts.map.digest(), now_us)
        for robot in self.replica.askable(wanted, now_us):
            self._ask(robot, now_us)
        awaited = self.joining.first and self.identity.is_relayed
        if wanted or not self.joining.is_done(awaited, now_us):
            return
        if self.joining.first:
            if self.joining.foreign and not self.membership.peers:
                self._stop(2, f"the team runs something else: {self.joining.foreign}")
                return
            others = self.mission.robots.keys() - {self.me}
            is_known = bool(self.facts.map.of_author(self.me))
            peers, digest = self.membership.peers, self.facts.map.digest()
            if self.joining.knows_all_of(others, peers, digest) and not is_known:
                self.grants.is_new()
            incarnation = self.replica.next_incarnation(self.identity.rival.counter)
            self._effects.append(fx.DeclareToken(incarnation))
        self.joining = None
        self.log("info", "joined", incarnation=str(self.replica.incarnation))
        member = (records.MEMBER, self.description.to_value())
        self.write([member, (records.CLAIM, None)], now_us)
        unsaid, self.unsaid = self.unsaid, {}
        set_conditions(self, unsaid, now_us)
        self.gossip.urge(now_us)

    def _replan(self, now_us: int) -> None:
        """Plan again if facts or the alive set have changed, until nothing more follows."""
        # Grants may have to be renewed meanwhile, and they are facts.
        apart = self.config.plans_apart and self.grants.is_idle
        changes = self.membership.changes
        while latched := self.planner.step(self.alive, changes, now_us, apart):
            self.write(latched, now_us)
        if self.planner.is_busy:
            self._effects.append(fx.MakePlan(self.planner.number))
        if self.planner.dropped:
            self._effects.append(fx.Forget(tuple(self.planner.dropped)))
            self.planner.dropped = []
        for reason in self.planner.failures:
            if self.refusals.count("solver", "broke its contract"):
                self.log("error", "solver_failed", reason=reason, instead="the default solver")
        self.planner.failures = []

    def _finish_mission(self, now_us: int) -> None:
        """Stop once every living robot has come to the same result, and has heard so."""
        plan = self.plan
        if self.joining is not None or plan is None or not self.is_over:
            self.done_us = None
            return
        if not self.membership.all_report(int(plan.result)) or not self.work.is_idle:
            self.done_us = None
        elif self.done_us is None:
            self.done_us = now_us
            self.log("info", "mission_over", result=plan.result.name.lower())
        elif self.config.exit_when_done and now_us >= self.done_us + self.config.timing.beat_us:
            self._beat_now(now_us)
            code = 0 if plan.result is Status.SUCCESS else 1
            self._stop(code, f"mission {plan.result.name.lower()}")

    # -- sending ------------------------------------------------------------------------------

    def _urgent(self) -> tuple[Any, ...]:
        """What the others must hear at once when it changes."""
        plan = self.plan
        digest, result = (plan.digest, plan.result) if plan else (b"", Status.RUNNING)
        granted = tuple([(grant.token, grant.member) for grant in self.grants.given()])
        standing = (self.joining is None, self.leaving)
        return digest, result, self.membership.accusations(), standing, self.grants.seeks, granted

    def _beat_now(self, now_us: int) -> None:
        plan = self.plan
        number = self.gossip.sent(self._urgent(), now_us)
        self.write(self.grants.sent(number, now_us, self._may_grant), now_us)
        digest, result = (plan.digest, plan.result) if plan else (bytes(8), Status.RUNNING)
        beat = Beat(
            Word(self.replica.incarnation, number, digest, self.joining is None, int(result)),
            self.leaving,
            self.facts.map.digest(),
            tuple([int(status) for status in self.tree.statuses]),
            self.work.progress,
            self.membership.accusations(),
            self.membership.heard(),
            self.grants.seeks,
            self.grants.given(),
        )
        data = self.config.engine.write_beat(beat, self.replica.header)
        self._effects.append(fx.Publish(MessageKind.BEAT, data))

    def write(self, values: Iterable[tuple[str, Any]], now_us: int) -> None:
        batch = list(values)
        if batch:
            data, entries = self.replica.write(batch, now_us)
            self._effects.append(fx.Persist(entries, synced=True))
            self._effects.append(fx.Publish(MessageKind.FACT, data))

    def order(self, kind: records.OrderKind, now_us: int) -> None:
        """Take in the operator's word and tell the team."""
        self.log("warning", "order", order=str(kind))
        self.write([(records.ORDER, [str(kind), self.replica.stamp()])], now_us)

    def _ask_who_is_due(self, now_us: int) -> None:
        for peer in self.replica.due(now_us):
            self._ask(peer, now_us)

    def _ask(self, peer: str, now_us: int) -> None:
        self.replica.asked(peer, now_us)
        self._effects.append(fx.Ask(peer, self.replica.pull()))

    def _refuse(self, source: str, reason: str, incompatible: bool = False) -> None:
        """Count what is refused; log it once per source and reason."""
        if self.refusals.count(source, reason):
            event = "robot_refused" if incompatible else "input_refused"
            self.log("error" if incompatible else "warning", event, source=source, reason=reason)
        if incompatible and self.joining is not None:
            self.joining.foreign = f"{source}: {reason}"

    def log(self, level: str, event: str, **fields: Any) -> None:
        self._effects.append(fx.Log(level, event, fields))

    def _stop(self, code: int, reason: str | None) -> None:
        if reason is not None and not self._stopped:
            self._stopped = True
            self._effects += self.work.drop()
            self._effects.append(fx.Stop(code, reason))

    def alive(self) -> dict[str, Incarnation]:
        """The plan's alive set, this robot included."""
        return self.membership.alive() | {self.me: self.replica.incarnation}

    def emit(self, effects: Iterable[fx.Effect]) -> None:
        """Have effects carried out, after those before."""
        self._effects += effects

    def grace_ends_us(self) -> int:
        """From when on this robot starts its line of the plan without agreement."""
        return self.work.line_since_us + self.config.timing.grace_us

    def in_doubt(self) -> list[tuple[str, list[records.Token]]]:
        """Requested exclusive activations that are in doubt, and the coalitions that left them."""
        requests = self.plan.evaluation.requests if self.plan is not None else ()
        givers = self.facts.givers
        doubts = [
            (r.activation, self.facts.coalitions(r.activation).doubted(givers)) for r in requests
        ]
        return [(activation, tokens) for activation, tokens in doubts if tokens]

    def _may_grant(self, activation: str, token: records.Token) -> bool:
        return may_grant(self, activation, token)

    @property
    def plan(self) -> Plan | None:
        """The plan of the last step, None while this robot has never joined."""
        return self.planner.plan

    @property
    def is_over(self) -> bool:
        """Whether this robot's plan has the mission's result."""
        plan = self.plan
        return plan is not None and plan.result in _RESULTS

    @property
    def is_new(self) -> bool:
        """Whether it has yet to join in this life: what it wrote now might not stand."""
        return self.joining is not None and self.joining.first

    @property
    def leaving(self) -> bool:
        """Whether this robot is on its way out."""
        return self.description.leaving

    @property
    def incarnation(self) -> Incarnation:
        """This robot's incarnation; counter 0 while it has never joined."""
        return self.replica.incarnation
