"""What a robot tells its team of itself: outcomes, conditions, bids, what it can do how well."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Persist, RequestBid
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    BidMade,
    BidsMade,
    CapabilityChanged,
    JournalOpened,
    JournalReported,
    JournalSynced,
)
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    JOURNAL,
    NO_CLAIM,
    Bid,
    ConditionValue,
    Order,
    OrderKind,
    Outcome,
    RobotProblem,
    as_subject,
)
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.membership.heartbeat import HeartbeatSchedule
from mrbt_mesh.core.mission.conditions import robot_condition
from mrbt_mesh.core.mission.failure_reasons import one_line
from mrbt_mesh.core.mission.names import type_name

CONDITIONS_PER_OUTCOME = 1_000
MAX_PROBLEMS = 20


class Reports:
    """Writes what a robot has to say.

    `asked_bids`: the (activation, local task) pairs for which its program was asked to bid.
    `unsaid`: conditions that a new life keeps until its incarnation is above all earlier ones.
    """

    def __init__(
        self, context: Context, planner: Planner, executor: Executor, schedule: HeartbeatSchedule
    ) -> None:
        self._context = context
        self._planner = planner
        self._executor = executor
        self._schedule = schedule
        self._asked_bids: set[tuple[str, str]] = set()
        self._failed_bids: set[str] = set()
        self._unsaid: dict[str, bool] = {}
        self._unsaid_problems: dict[str, str] = {}

    def finished(self, event: ActionFinished, now_us: int) -> None:
        """Write the outcome, what its tick of T_G has found, its conditions and the end of the
        claim, as one batch.
        """
        context, work = self._context, self._context.work
        claimed = work.claim
        action = work.finish(event.ticket, event.success)
        if action is None:
            return
        name = f"{records.OUTCOME}/{action.activation}/{action.local_task}"
        if action.coalition:
            name += f"/{action.coalition}"
        reason = "" if event.success else one_line(event.reason)
        facts: list[Fact] = [(name, Outcome(event.success, None, reason))]
        ends = context.mission.conditions_after_end(
            action.global_task, action.local_task, event.success, reason
        )
        conditions = self._changed_conditions([*event.conditions, *ends])
        if conditions:
            version = context.replica.next_version
            status = context.facts.status_after(name, context.me, event.success, version)
            values = {condition: record.value for condition, record in conditions.items()}
            facts += self._planner.tick_outcome(action.activation, status, values)
            facts += _condition_facts(conditions)
        if work.claim is None and claimed is not None:
            facts.append((records.CLAIM, NO_CLAIM))
        context.write(facts, now_us)
        context.log(
            "info" if event.success else "warning",
            "local_task_finished",
            global_task=action.global_task,
            local_task=action.local_task,
            outcome="success" if event.success else "failure",
            error=event.error,
        )

    # -- conditions ---------------------------------------------------------------------------

    def set_conditions(self, values: Mapping[str, bool], now_us: int) -> None:
        """Tell them; a new life keeps them until it has an incarnation above all earlier ones."""
        if self._context.is_new:
            mission = self._context.mission
            known = {n: v for n, v in values.items() if mission.knows_condition(n)}
            self._unsaid |= known
            values = {n: v for n, v in values.items() if n not in known}
        changed = self._changed_conditions(values.items())
        if changed:
            self._context.write(_condition_facts(changed), now_us)

    def say_what_was_kept(self, now_us: int) -> None:
        """The robot has joined: tell the conditions that were set before."""
        unsaid, self._unsaid = self._unsaid, {}
        self.set_conditions(unsaid, now_us)
        problems, self._unsaid_problems = self._unsaid_problems, {}
        for subject, text in problems.items():
            self.problem_found(subject, text, now_us)
        self._say_of_journal(now_us)

    def _changed_conditions(
        self, conditions: Iterable[tuple[str, bool]]
    ) -> dict[str, ConditionValue]:
        """The new values of conditions; those that have this value already are left out."""
        context, facts = self._context, self._context.facts
        changed: dict[str, ConditionValue] = {}
        stamp = context.replica.next_stamp()
        for given, value in conditions:
            name = self._name_here(given)
            revision = facts.conditions.revision(name)
            if not context.mission.can_be_set(name):
                context.log("error", "condition_not_declared", condition=name)
            elif facts.condition(name) != value:
                changed[name] = ConditionValue(value, revision + 1, stamp)
            elif revision and name != given and self._last_word(name) != value:
                # Others have written this of this robot, which no longer contradicts them.
                changed[name] = ConditionValue(value, revision, stamp)
            else:
                changed.pop(name, None)
        return changed

    def _name_here(self, condition: str) -> str:
        """A condition as this robot's program names it: its own one, if every robot has its own."""
        is_own = condition in self._context.mission.per_robot
        return robot_condition(condition, self._context.me) if is_own else condition

    def _last_word(self, name: str) -> bool:
        """What this robot itself has said last of a condition."""
        context = self._context
        entry = context.facts.map.get(context.me, f"{records.CONDITION}/{name}")
        if entry is not None and isinstance(entry.record, ConditionValue):
            return entry.record.value
        return context.mission.condition_default(name)

    def contradict(self, now_us: int) -> None:
        """Tell again of itself what others took for lost, while they did not hear this robot."""
        context, facts = self._context, self._context.facts
        if context.is_leaving or context.me not in context.mission.robots:
            return
        changed: dict[str, ConditionValue] = {}
        for leaf in context.mission.per_robot.leaves:
            name = robot_condition(leaf, context.me)
            value = self._last_word(name)
            if facts.condition(name) != value:
                revision = facts.conditions.revision(name) + 1
                changed[name] = ConditionValue(value, revision, context.replica.next_stamp())
        if changed:
            context.write(_condition_facts(changed), now_us)

    # -- bids ---------------------------------------------------------------------------------

    def ask_for_bids(self) -> None:
        """Have this robot's program bid for what the plan lacks its bids for, once each."""
        context, plan = self._context, self._planner.plan
        assert plan is not None
        if not plan.biddings:
            self._asked_bids.clear()
            return
        wanted = {
            (bidding.activation, bidding.local_task): bidding.global_task
            for bidding in plan.biddings
            if context.me in bidding.silent
        }
        fresh = sorted(wanted.keys() - self._asked_bids)
        self._asked_bids = set(wanted)
        incarnation = context.replica.incarnation
        for place in fresh:
            value = context.description.performance(place[1])
            if value is not None:
                activation, local_task = place
                context.emit(RequestBid(activation, wanted[place], local_task, value, incarnation))

    def bids_made(self, event: BidsMade, now_us: int) -> None:
        """Tell the team, all in one batch. What was asked for before a new life is asked again."""
        context = self._context
        if context.joining is not None:
            self._asked_bids.clear()
            return
        writes: dict[str, Bid] = {}
        problems: dict[str, str] = {}
        for bid in event.bids:
            name = f"{records.BID}/{bid.activation}/{bid.local_task}"
            record, error = _checked_bid(bid)
            if error:
                subject = f"bid for {type_name(bid.local_task)}"
                if subject not in self._failed_bids:
                    self._failed_bids.add(subject)
                    context.log("error", "bid_failed", local_task=bid.local_task, error=error)
                problems[subject] = f"made no bid: {bid.reason or error}"
            if (bid.activation, bid.local_task) in self._asked_bids:
                writes[name] = record  # else nobody needs it any more
        facts: list[Fact] = [(name, writes[name]) for name in sorted(writes)]
        facts += self._problem_facts(problems)
        if facts:
            context.write(facts, now_us)

    # -- problems of its program --------------------------------------------------------------

    def problem_found(self, subject: str, text: str, now_us: int) -> None:
        """Tell the team what is wrong with a part of the program; a new life keeps it until then.

        The first MAX_PROBLEMS parts are told; the log has them all.
        """
        context = self._context
        if context.is_new:
            self._unsaid_problems[subject] = text
            return
        facts = self._problem_facts({subject: text})
        if facts:
            context.write(facts, now_us)

    def _problem_facts(self, problems: Mapping[str, str]) -> list[Fact]:
        """The facts of new problems and of solved ones; nothing that is known already."""
        context = self._context
        known = context.facts.problems.get(context.me, {})
        writes: dict[str, str] = {}
        for given, text in problems.items():
            subject, line = as_subject(given), one_line(text)
            is_told = subject in known or len(known) + len(writes) < MAX_PROBLEMS
            if is_told and known.get(subject, "") != line:
                if line:
                    context.log("error", "problem", subject=subject, problem=line)
                writes[f"{records.PROBLEM}/{subject}"] = line
        return [(name, RobotProblem(writes[name])) for name in sorted(writes)]

    # -- itself -------------------------------------------------------------------------------

    def change_capability(self, change: CapabilityChanged, now_us: int) -> str | None:
        """Declare a minor fault or its end; returns what is wrong with it, or None."""
        description, name, source = self._context.description, change.local_task, change.source
        if not change.lost:
            return self._change(lambda: description.restore(name, source), now_us)
        reason, is_pending = change.reason, change.is_pending
        return self._change(lambda: description.lose(name, reason, source, is_pending), now_us)

    def change_performance(
        self, local_task: str, value: int, source: str, now_us: int
    ) -> str | None:
        """Tell how well this robot does something now; returns what is wrong with it, or None."""
        description = self._context.description
        return self._change(lambda: description.perform(local_task, value, source), now_us)

    def _change(self, change: Callable[[], str | None], now_us: int) -> str | None:
        """Change the description, and tell the team if that makes a difference."""
        context, description = self._context, self._context.description
        before = description.changes()
        problem = change()
        if problem is not None:
            context.log("error", "capability_unknown", reason=problem)
            return problem
        after = description.changes()
        if after == before:
            return None
        context.log("warning", "capabilities_changed", **after)
        if context.has_place:
            context.write([(records.MEMBER, description.member(context.is_leaving))], now_us)
        return None

    # -- its journal --------------------------------------------------------------------------

    def journal(self, event: JournalSynced | JournalReported | JournalOpened, now_us: int) -> None:
        """Take in how far the journal is, or what is wrong with it, and tell everybody of that."""
        context, durability = self._context, self._context.durability
        match event:
            case JournalSynced(number):
                durability.note_synced(number)
                self._executor.leases.take_own_answers()
            case JournalReported(problem, is_failing):
                durability.problem, durability.is_failing = problem, is_failing
            case JournalOpened(entries):
                context.replica.restore(entries)
                held = {entry.hash for entry in entries}
                lacking = tuple(e for e in context.facts.map if e.hash not in held)
                context.log("warning", "journal_opened_anew", entries=len(entries))
                context.emit(Persist(lacking, True, durability.begin_anew()))
        self._say_of_journal(now_us)

    def _say_of_journal(self, now_us: int) -> None:
        """Tell what is wrong with the journal, and whether it allows promises, if that is news."""
        context, durability = self._context, self._context.durability
        may_promise = durability.may_promise
        is_news = context.description.may_promise != may_promise
        context.description.may_promise = may_promise
        if context.is_new:
            return
        facts = self._problem_facts({JOURNAL: durability.problem})
        if is_news:
            facts.append((records.MEMBER, context.description.member(context.is_leaving)))
        if is_news and may_promise:
            context.log("info", "journal_works_again")
        if facts:
            context.write(facts, now_us)

    def leave(self, now_us: int) -> None:
        """Hand the work over, and tell everybody at once."""
        context = self._context
        if context.is_leaving:
            return
        context.is_leaving = True
        context.log("info", "leaving")
        claim = context.work.claim
        writes = self._executor.given_up(claim) if claim is not None else []
        context.emit(*context.work.drop())
        if context.has_place:
            member = (records.MEMBER, context.description.member(context.is_leaving))
            context.write([*writes, member, (records.CLAIM, NO_CLAIM)], now_us)
        self._schedule.make_due(now_us)

    def order(self, kind: OrderKind, now_us: int) -> None:
        """Take in the operator's word and tell the team."""
        context = self._context
        context.log("warning", "order", order=str(kind))
        context.write([(records.ORDER, Order(kind, context.replica.next_stamp()))], now_us)


def _condition_facts(changed: Mapping[str, ConditionValue]) -> list[Fact]:
    return [(f"{records.CONDITION}/{name}", value) for name, value in changed.items()]


def _checked_bid(bid: BidMade) -> tuple[Bid, str]:
    """The bid of a robot's program, none if something is wrong with it, and what that is."""
    try:
        return Bid.parse(None if bid.error else bid.performance), bid.error
    except ValueError as error:
        return Bid(None), str(error)
