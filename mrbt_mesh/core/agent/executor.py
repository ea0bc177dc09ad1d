"""T_Li at work: following this robot's line of the plan, from the claim to the action.

A robot starts once the team agrees (`may_start`). Where a coalition carries out the task, it
then is *ready*: the leader starts when enough members are, the others when the leader has
written them down. For an exclusive task each of them also needs the grants of a majority.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.coalitions import are_enough, coalition_at_work, ready_members
from mrbt_mesh.core.facts.records import LATCH, NO_CLAIM, Claim, Coalition, CoalitionId, Phase
from mrbt_mesh.core.facts.store import Fact, Incarnation
from mrbt_mesh.core.membership.leases import Leases
from mrbt_mesh.core.membership.wire import Heartbeat
from mrbt_mesh.core.mission.mission import GlobalTask
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.plan import Plan


class Executor:
    """Claims, gets ready and starts what the plan has for this robot; stops what it has not.

    `shows_outcome`: T_Li was ticked with an outcome, and is to be ticked again.
    """

    def __init__(self, context: Context, planner: Planner, tree: RobotTree, leases: Leases) -> None:
        self._context = context
        self._planner = planner
        self.tree = tree
        self.leases = leases
        self.shows_outcome = False
        # By which to know whether the claim of a robot that is ready is on disk.
        self._ready = 0

    def perform(self, now_us: int) -> None:
        """Follow the plan; cancel, claim, get ready and start what it says."""
        context, plan, work = self._context, self._plan, self._context.work
        before = work.claim
        line = None if context.is_leaving else plan.lines.get(context.me)
        changed, effects = work.follow(line, context.replica.next_stamp(), now_us)
        if effects:
            context.emit(*effects)
        writes = self.given_up(before) if changed and before is not None else []
        token: CoalitionId | None = None
        is_waiting = work.is_waiting
        is_cleared = work.claim is not None and not is_waiting
        if is_waiting and self._may_start(now_us):
            task = self._task()
            if task.by_coalition and self._may_promise(task):
                if work.claim is not None and work.claim.phase is Phase.CLAIMED:
                    work.get_ready()
                    # The coalition's leader refers to this entry, also if it is this robot.
                    self._ready = context.promise([*writes, self._claim_write()], now_us)
                    writes, changed = [], False
                token, more = self._coalition(task, now_us)
                writes += more
            is_cleared = token is not None or not task.by_coalition
        assigned = type_name(work.claim.local_task) if work.claim is not None else None
        wanted = self._tick(plan, assigned if is_cleared else None)
        if wanted is not None and is_waiting:
            start = self._start(plan, token)
            context.write([*writes, self._claim_write()], now_us)
            self._announce(start)
        elif changed and work.claim != before:
            context.write([*writes, self._claim_write()], now_us)
        self._seek_lease()

    def _may_promise(self, task: GlobalTask) -> bool:
        """Whether the journal lets this robot work on the task: an exclusive one needs it."""
        return not task.exclusive or self._context.durability.may_promise

    def _tick(self, plan: Plan, assigned: str | None) -> str | None:
        """Tick T_Li: first with what has ended, if anything has, then with what is assigned.

        If nothing is, the tick before is not followed by another one at once: T_Li shows the
        outcome until something happens.
        """
        work = self._context.work
        ended, work.ended = work.ended, None
        self.shows_outcome = ended is not None and assigned is None
        if ended is not None:
            local_task, outcome = ended
            self.tree.tick(plan.result, type_name(local_task), outcome)
        return None if self.shows_outcome else self.tree.tick(plan.result, assigned)

    @property
    def _plan(self) -> Plan:
        plan = self._planner.plan
        assert plan is not None
        return plan

    def _start(self, plan: Plan, token: CoalitionId | None) -> StartAction:
        context, claim = self._context, self._context.work.claim
        assert claim is not None
        value = context.description.performance(claim.local_task)
        assert value is not None
        coalition = str(token) if token is not None else ""
        partners = plan.partners(context.me)
        return context.work.start(partners, value, context.replica.incarnation, coalition)

    def _announce(self, start: StartAction) -> None:
        self._context.emit(start)
        self._context.log(
            "info",
            "local_task_started",
            global_task=start.global_task,
            local_task=start.local_task,
            activation=start.activation,
        )

    def _claim_write(self) -> Fact:
        return records.CLAIM, self._context.work.claim or NO_CLAIM

    def _task(self) -> GlobalTask:
        claim = self._context.work.claim
        assert claim is not None
        return self._context.mission.global_tasks[claim.global_task]

    def _may_start(self, now_us: int) -> bool:
        """Whether all robots in good standing have the same plan, or the grace time has passed."""
        return (
            self._context.membership.all_report_plan(self._plan.digest)
            or now_us >= self.grace_ends_us
        )

    @property
    def grace_ends_us(self) -> int:
        """From when on this robot starts its line of the plan without agreement."""
        return self._context.work.line_since_us + self._context.config.timing.grace_us

    # -- coalitions ---------------------------------------------------------------------------

    def _token_sought(self) -> CoalitionId | None:
        """The coalition that this robot is ready for, or runs with; None without any."""
        context, facts, work = self._context, self._context.facts, self._context.work
        line, claim = work.line, work.claim
        if line is None or claim is None or not line.leader or claim.phase is Phase.CLAIMED:
            return None
        if claim.coalition:
            return CoalitionId.parse(claim.coalition)
        if line.leader == context.me:
            return CoalitionId(claim.since, context.me, *context.replica.incarnation)
        leaders = facts.valid_claim(line.leader)
        if (
            leaders is None
            or leaders.activation != line.activation
            or leaders.phase is Phase.CLAIMED
        ):
            return None
        return CoalitionId(leaders.since, line.leader, *facts.members[line.leader].incarnation)

    def _coalition(self, task: GlobalTask, now_us: int) -> tuple[CoalitionId | None, list[Fact]]:
        """The coalition with which this robot may start now, and what to write with it.

        For an exclusive task its claim must be on disk: what may have begun is known after a crash.
        """
        context, facts, plan = self._context, self._context.facts, self._plan
        if task.exclusive and not context.durability.is_on_disk(self._ready):
            return None, []
        line, claim = context.work.line, context.work.claim
        assert line is not None
        assert claim is not None
        if line.leader != context.me:
            return self._written_down(task, line.activation, claim, now_us), []
        token = self._token_sought()
        assert token is not None
        if task.exclusive and not self.leases.holder.is_held(line.activation, token, now_us):
            return None, []
        lines = plan.lines.values()
        planned = {x.robot: x.local_task for x in lines if x.activation == line.activation}
        members = ready_members(facts, line.activation, planned)
        if not are_enough(task, members):
            return None, []
        if len(members) < len(planned) and now_us < self.grace_ends_us:
            return None, []  # the others may be ready in a moment
        name = f"{records.COALITION}/{line.activation}/{token}"
        return token, [(name, Coalition(tuple(members)))]

    def _written_down(
        self, task: GlobalTask, activation: str, claim: Claim, now_us: int
    ) -> CoalitionId | None:
        """The standing coalition, if its leader has written down this robot's present claim."""
        context, facts = self._context, self._context.facts
        found = facts.coalitions(activation)
        token = coalition_at_work(facts, task, activation, context.alive())
        if token is None or (
            task.exclusive and not self.leases.holder.is_held(activation, token, now_us)
        ):
            return None
        mine = (claim.since, context.me, context.replica.incarnation)
        for member in found.members[token]:
            if (member.since, member.robot, Incarnation(member.counter, member.nonce)) == mine:
                return token
        return None

    def given_up(self, claim: Claim) -> list[Fact]:
        """What to say of a claim on an exclusive task that is dropped without an outcome.

        Begun, it leaves the activation in doubt; a leader that never began sets its grants free.
        """
        context, facts = self._context, self._context.facts
        if not context.mission.global_tasks[claim.global_task].exclusive:
            return []
        activation = claim.activation
        if claim.phase is Phase.RUNNING:
            doubts = facts.coalitions(activation).doubts
            if context.me in doubts.get(CoalitionId.parse(claim.coalition), ()):
                return []
            return [(f"{records.DOUBT}/{activation}/{claim.coalition}", LATCH)]
        token = CoalitionId(claim.since, context.me, *context.replica.incarnation)
        if self.leases.holder.requested == (activation, str(token)):
            return [(f"{records.CLEARED}/{activation}/{token}", LATCH)]
        return []

    # -- leases -------------------------------------------------------------------------------

    def _seek_lease(self) -> None:
        """Ask for the grants that this robot's claim needs."""
        context, claim = self._context, self._context.work.claim
        if claim is not None and context.mission.global_tasks[claim.global_task].exclusive:
            self.leases.holder.request(claim.activation, self._token_sought())
        elif self.leases.holder.requested is not None:
            self.leases.holder.request("", None)

    def check_leases(self, now_us: int) -> None:
        """Follow the grants that this robot has given; stop where its own have run out."""
        context, claim = self._context, self._context.work.claim
        writes = self.leases.grantor.expire(now_us)
        if writes:
            context.write(writes, now_us)
        if claim is None or claim.phase is not Phase.RUNNING:
            return
        if not context.mission.global_tasks[claim.global_task].exclusive:
            return
        token = CoalitionId.parse(claim.coalition)
        found = context.facts.coalitions(claim.activation)
        ended = token in found.broken or context.me in found.doubts.get(token, ())
        if not ended and not self.leases.holder.is_held(claim.activation, token, now_us):
            context.log("warning", "grants_ran_out", global_task=claim.global_task)
            names = (records.DOUBT, records.BROKEN)
            context.write([(f"{name}/{claim.activation}/{token}", LATCH) for name in names], now_us)

    def lease_asked(self, robot: str, beat: Heartbeat, now_us: int) -> None:
        """A beat asks for a lease, or answers this robot's own request."""
        writes = self.leases.receive_heartbeat(robot, beat, now_us, self.may_grant)
        if writes:
            self.leases.grantor.written(self._context.promise(writes, now_us))

    def may_grant(self, activation: str, token: CoalitionId) -> bool:
        """Whether this robot's own view speaks for giving `activation` to this coalition."""
        context, facts, plan = self._context, self._context.facts, self._planner.plan
        if context.joining is not None or context.is_leaving or plan is None:
            return False
        if facts.coalitions(activation).unended(facts.grantors)[:1] == [token]:
            return True
        line = plan.lines.get(token.leader)
        life = (token.counter, token.nonce)
        known = facts.members.get(token.leader)
        return (
            line is not None
            and (line.activation, line.leader) == (activation, token.leader)
            and known is not None
            and known[1] == life
        )
