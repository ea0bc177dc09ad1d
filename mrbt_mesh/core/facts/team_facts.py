"""How a team reads its facts: members, claims, outcomes, conditions, the operator's orders.

`TeamFacts` is the fact map of one mission and run with the indices that evaluation and
planning need; it provides `EvaluationFacts` for T_G.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mrbt_mesh.core.bt.activation import Activation, parse_activation
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, CONTROLS, Kind, Memory, Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.coalitions import Coalitions
from mrbt_mesh.core.facts.records import (
    Attempt,
    Bid,
    ChildResult,
    Claim,
    Coalition,
    CoalitionId,
    ConditionValue,
    Latch,
    Member,
    NoClaim,
    Order,
    OrderKind,
    Outcome,
)
from mrbt_mesh.core.facts.scopes import FactChanges, ScopedEntries
from mrbt_mesh.core.facts.store import Change, Entry, FactMap, Incarnation
from mrbt_mesh.core.mission.mission import (
    FailurePolicy,
    GlobalTask,
    Mission,
    Need,
    performance,
    type_name,
)

# Kinds of entry that belong to an activation or scope, and the nodes that may have them.
_SCOPED = {
    records.OUTCOME: frozenset({Kind.ACTION}),
    records.VERDICT: frozenset({Kind.ACTION}),
    records.ATTEMPT: ATTEMPT_KINDS,
    records.EXPIRED: frozenset({Kind.TIMEOUT}),
    records.CHILD_RESULT: CONTROLS,
    records.DONE: frozenset({Kind.ACTION}),
    **dict.fromkeys(sorted(records.COALITION_KINDS | records.BID_KINDS), frozenset({Kind.ACTION})),
}


def capability(member: Member, local_task: str) -> int | None:
    """p(i, l) in micro-units of a member, None where it cannot do it or has lost it."""
    if local_task in member.lost or type_name(local_task) in member.lost:
        return None
    return performance(member.capabilities, local_task)


class TeamFacts:
    """The replicated facts of one run of one mission, indexed."""

    def __init__(self, mission: Mission, run: str) -> None:
        self.mission = mission
        self.run = run
        self.map = FactMap(self._changed)
        self.members: dict[str, tuple[Member, Incarnation]] = {}
        self.claims: dict[str, tuple[Claim, Incarnation]] = {}
        # By activation, local task and robot; of an activation that has changed, another object.
        self.outcomes: dict[str, Mapping[str, Mapping[str, bool]]] = {}
        self.max_stamp = 0
        self.changes = 0
        self.outcome_changes = 0
        tasks = mission.global_tasks.values()
        self._tree_reads_claims = any(task.failure is FailurePolicy.PAPER for task in tasks)
        self._scoped = ScopedEntries()
        self._followers: list[FactChanges] = []
        # Nodes of which somebody has told a failure: who else is able matters there.
        self._failed_at: dict[int, None] = {}
        # Activations that have nu successes of each local task, without coalitions.
        self._succeeded: set[str] = set()
        self._conditions: dict[str, dict[str, ConditionValue]] = {}
        self._best: dict[str, ConditionValue] = {}
        self._values: dict[str, bool] = {}
        self._defaults: dict[str, bool] = {}
        self._orders: dict[str, Order] = {}
        self._latches: dict[str, dict[str, int]] = {}
        self._coalitions: dict[str, Coalitions] = {}
        self._bids: dict[tuple[str, str], dict[str, int | None]] = {}
        # By activation, a sum of hashes over its bids and whether they are closed.
        self._bid_states: dict[str, int] = {}
        self.grantors = frozenset(mission.robots)

    # -- EvaluationFacts ------------------------------------------------------------------

    def condition(self, name: str) -> bool:
        """The value with the greatest (revision, stamp, author), or the declared default."""
        value = self._values.get(name)
        if value is None:
            value = self._values[name] = self._default(name)
        return value

    def _default(self, name: str) -> bool:
        default = self._defaults.get(name)
        if default is None:
            default = self._defaults[name] = self.mission.condition_default(name)
        return default

    def turns(self, name: str, value: bool) -> int:
        """How often the condition has turned to `value`: a boolean alternates from its default."""
        best = self._best.get(name)
        return self.turns_at(name, value, best.revision) if best is not None else 0

    def turns_at(self, name: str, value: bool, revision: int) -> int:
        """The same for any revision of the condition."""
        return revision // 2 if value == self._default(name) else (revision + 1) // 2

    def task_status(self, subject: str, activation: str) -> Status:
        """The paper's *Perform Global Task*: success at nu successes of each local task."""
        if activation not in self._scoped.by_scope:
            return Status.RUNNING  # nobody has said anything of it
        if activation in self._succeeded:
            return Status.SUCCESS
        task = self.mission.global_tasks[subject]
        if task.by_coalition:
            return self._coalition_status(task, activation)
        if self.has_verdict(activation):
            return Status.FAILURE
        if any(self._need_failed(task, need, activation) for need in task.needs):
            return Status.FAILURE
        return Status.RUNNING

    def _coalition_status(self, task: GlobalTask, activation: str) -> Status:
        found = self.coalitions(activation)
        if found.has_succeeded(task) or f"{records.DONE}/{activation}" in self._latches:
            return Status.SUCCESS
        if self.has_verdict(activation) or found.has_failed(task, self._known_able, self.grantors):
            return Status.FAILURE
        return Status.RUNNING

    def _known_able(self, local_task: str) -> list[str]:
        """All known robots capable of it, dead ones and ones that lost it included."""
        members = self.members.items()
        return [r for r, (m, _) in members if performance(m.capabilities, local_task)]

    def attempts_used(self, activation: str) -> int:
        """The number of attempts that are used up, over all authors."""
        if activation not in self._scoped.by_scope:
            return 0
        return max(self._latches.get(f"{records.ATTEMPT}/{activation}", {}).values(), default=0)

    def has_expired(self, activation: str) -> bool:
        """Whether anybody has seen this Timeout's deadline pass."""
        return (
            activation in self._scoped.by_scope
            and f"{records.EXPIRED}/{activation}" in self._latches
        )

    def child_result(self, activation: str, position: int) -> Status | None:
        """How that child of a node with memory ended; success, if anybody says so."""
        if activation not in self._scoped.by_scope:
            return None
        said = self._latches.get(f"{records.CHILD_RESULT}/{activation}/{position}")
        if said is None:
            return None
        return Status.SUCCESS if any(said.values()) else Status.FAILURE

    # -- what else planning reads ---------------------------------------------------------

    def has_verdict(self, activation: str) -> bool:
        """Whether the failure of this activation has been latched."""
        return f"{records.VERDICT}/{activation}" in self._latches

    def revision(self, name: str) -> int:
        """How often the condition has changed."""
        best = self._best.get(name)
        return best.revision if best is not None else 0

    def order(self) -> OrderKind:
        """The operator's standing order; RESUME where nothing was said. Abort is absorbing."""
        kinds = [order.kind for order in self._orders.values()]
        if OrderKind.ABORT in kinds:
            return OrderKind.ABORT
        latest = max(((o.stamp, a, o.kind) for a, o in self._orders.items()), default=None)
        return latest[2] if latest else OrderKind.RESUME

    def results(self, activation: str, local_task: str) -> Mapping[str, bool]:
        """Robot -> success, for the outcomes of one local task of one activation.

        Of coalitions, the failures of all and the successes of the first that has not ended.
        """
        found = self._coalitions.get(activation)
        if found is None:
            return self.outcomes.get(activation, {}).get(local_task, {})
        unended = found.unended(self.grantors)
        ends = found.outcomes.get(unended[0], {}) if unended else {}
        return dict.fromkeys(found.failed_robots(local_task), False) | {
            robot: True for robot, success in ends.get(local_task, {}).items() if success
        }

    def begun(self) -> set[str]:
        """The activations of which some outcome is known."""
        found = self._coalitions.items()
        return {*self.outcomes, *(name for name, coalitions in found if coalitions.outcomes)}

    def is_begun(self, activation: str) -> bool:
        """Whether some outcome of the activation is known."""
        found = self._coalitions.get(activation)
        return activation in self.outcomes or (found is not None and bool(found.outcomes))

    def bids(self, activation: str, local_task: str) -> Mapping[str, int | None]:
        """Robot -> its performance by its own word, in micro-units; None: it has no bid."""
        return self._bids.get((activation, local_task), {})

    def bid_state(self, activation: str) -> int:
        """Equal for equal facts about the bids of an activation."""
        return self._bid_states.get(activation, 0)

    def is_closed(self, activation: str, local_task: str) -> bool:
        """Whether somebody has waited for bids long enough."""
        return f"{records.CLOSED}/{activation}/{local_task}" in self._latches

    def coalitions(self, activation: str) -> Coalitions:
        """What is known of the coalitions of one activation."""
        return self._coalitions.get(activation) or Coalitions()

    def granted(self) -> list[tuple[str, Coalitions]]:
        """The activations for which somebody has given a grant, sorted."""
        return sorted((name, found) for name, found in self._coalitions.items() if found.grants)

    def task_of(self, activation: str) -> GlobalTask | None:
        """The global task of an activation, None if there is none of that name."""
        try:
            return self.mission.global_tasks.get(parse_activation(activation).subject)
        except ValueError:
            return None

    def valid_claim(self, robot: str) -> Claim | None:
        """The robot's claim if the incarnation that made it is the robot's newest one."""
        held, member = self.claims.get(robot), self.members.get(robot)
        return held[0] if held and member and held[1] == member[1] else None

    def _need_failed(self, task: GlobalTask, need: Need, activation: str) -> bool:
        """Paper, section IV-b, and the two policies of ARCHITECTURE.md.

        Never a function of who is thought alive: lack of living robots is *blocked*.
        """
        results = self.results(activation, need.local_task)
        failures = sum(not success for success in results.values())
        if not failures:
            return False
        if task.failure is FailurePolicy.PAPER:
            assigned = len(results)
            for robot in self.claims:
                claim = self.valid_claim(robot)
                if claim and robot not in results and claim.activation == activation:
                    assigned += claim.local_task == need.local_task
            return failures > assigned - need.min_robots
        able = len(results) - failures
        able += sum(robot not in results for robot in self._known_able(need.local_task))
        return able < need.min_robots

    # -- keeping the indices --------------------------------------------------------------

    def follow(self) -> FactChanges:
        """What changes from now on, and the conditions that somebody has set before."""
        changes = FactChanges(dict.fromkeys(self._best))
        self._followers.append(changes)
        return changes

    def prune(self, evaluator: Evaluator) -> list[tuple[str, str]]:
        """Drop what no evaluation can reach any more; every replica drops the same.

        Returns authors and names, sorted. Dropping what is out of reach changes the reach of
        nothing.
        """
        obsolete = self._scoped.take_obsolete(evaluator, self)
        for author, name in obsolete:
            self.map.drop(author, name)
        return obsolete

    def accepts(self, entry: Entry) -> str | None:
        """Why this entry has no place in this mission, or None if it has one."""
        parts = entry.parts
        if parts[0] == records.CONDITION:
            if not self.mission.knows_condition(parts[1]):
                return f"condition {parts[1]!r} is not declared"
            record = entry.record
            assert isinstance(record, ConditionValue)
            default = self.mission.condition_default(parts[1])
            if record.value != (default ^ bool(record.revision % 2)):
                return f"condition {parts[1]!r}: value and revision {record.revision} disagree"
        elif parts[0] in _SCOPED:
            try:
                scope = parse_activation(parts[1])
            except ValueError:
                return f"{parts[1]!r:.80} names no activation"
            if scope.run != self.run:
                return f"{parts[1]!r:.80} belongs to another run"
            if str(scope) != parts[1] or not self._fits(parts[0], scope):
                return f"{parts[1]!r:.80} names no node of this mission's tree"
            if parts[0] == records.CHILD_RESULT:
                node = self.mission.tree.nodes[scope.node]
                if node.memory is Memory.NONE or parts[2] not in map(
                    str, range(len(node.children))
                ):
                    return f"{parts[1]!r:.80} has no child {parts[2]!r:.20} to remember"
            if _SCOPED[parts[0]] == {Kind.ACTION}:
                return self._misfit(parts, self.mission.global_tasks[scope.subject], entry)
        return None

    def _misfit(self, parts: tuple[str, ...], task: GlobalTask, entry: Entry) -> str | None:
        """Why an entry of an activation has no place in it."""
        kind, *names = parts
        needs = {need.local_task for need in task.needs}
        if kind == records.OUTCOME:
            if names[1] not in needs:
                return f"{task.id!r} needs no {names[1]!r:.80}"
            if (len(names) == 3) != task.by_coalition:
                return f"{task.id!r}: an outcome names a coalition if the task has any"
        elif kind in records.BID_KINDS:
            need = task.need(names[1])
            if need is None or not need.by_bid:
                return f"{task.id!r}: {names[1]!r:.80} is not for bids"
        elif kind in records.EXCLUSIVE_KINDS and not task.exclusive:
            return f"{task.id!r} is not exclusive"
        elif kind in records.COALITION_KINDS and not task.by_coalition:
            return f"{task.id!r} has no coalitions"
        if kind in records.COALITION_KINDS or len(names) == 3:
            try:
                token = CoalitionId.parse(names[-1])
            except ValueError:
                return f"{names[-1]!r:.80} names no coalition"
            if isinstance(entry.record, Coalition) and (
                entry.author != token.leader
                or any(member.local_task not in needs for member in entry.record.members)
            ):
                return f"{names[-1]!r:.80}: no coalition of {task.id!r}"
        return None

    def _fits(self, kind: str, scope: Activation) -> bool:
        """Whether some evaluation could use this name for an entry of this kind."""
        nodes = self.mission.tree.nodes
        if not 0 <= scope.node < len(nodes) or min((scope.turns, *scope.attempts)) < 0:
            return False
        node = nodes[scope.node]
        if node.kind not in _SCOPED[kind] or node.subject != scope.subject:
            return False
        attempts, outer = 0, node.parent
        while outer >= 0:
            attempts += nodes[outer].kind in ATTEMPT_KINDS
            outer = nodes[outer].parent
        return len(scope.attempts) == attempts

    def _changed(self, changes: Sequence[Change]) -> None:
        for old, new in changes:
            self.changes += 1
            self._index(old, new)

    def _index(self, old: Entry | None, new: Entry | None) -> None:
        entry = new or old
        assert entry is not None
        parts = entry.parts
        author, record = entry.author, entry.record
        if parts[0] in records.BID_KINDS:
            self._bids_change(parts[1], old, new)
        if parts[0] in _SCOPED:
            self._scope_changed(parts, entry, new is None)
        if new is None:
            self._forget(parts, author)
            return
        match record:
            case Member():
                self._described(author, record, entry.version.incarnation)
            case Claim() | NoClaim():
                self._claimed(author, record, entry.version.incarnation)
            case Outcome():
                self._ended(parts, entry, record)
            case Coalition() | Latch() if parts[0] in records.COALITION_KINDS:
                token = CoalitionId.parse(parts[2])
                self._coalition(parts).add(parts[0], token, entry)
                self.max_stamp = max(self.max_stamp, token.since)
            case ConditionValue():
                self._condition_changes(parts[1])
                values = self._conditions.setdefault(parts[1], {})
                values[author] = record
                ranked = max((v.revision, v.stamp, a) for a, v in values.items())
                self._best[parts[1]] = values[ranked[2]]
                self._values[parts[1]] = values[ranked[2]].value
                self.max_stamp = max(self.max_stamp, record.stamp)
            case Order():
                self._orders[author] = record
                self.max_stamp = max(self.max_stamp, record.stamp)
            case Bid(number):
                self._bids.setdefault((parts[1], parts[2]), {})[author] = number
            case Attempt() | Latch() | ChildResult():
                self._latched(entry, record)

    def _scope_changed(self, parts: tuple[str, ...], entry: Entry, is_dropped: bool) -> None:
        change = self._scoped.remove if is_dropped else self._scoped.add
        node = change(parts[1], (entry.author, entry.name))
        if parts[0] == records.CHILD_RESULT:
            for changes in self._followers:
                changes.child_results[node, int(parts[2])] = None
            return
        if parts[0] in records.BID_KINDS:
            return  # no tree reads them
        self._nodes_change(node)
        if parts[0] == records.ATTEMPT and not is_dropped:
            self._scoped.goes_round(node)
        if isinstance(entry.record, Outcome) and not entry.record.success:
            self._failed_at[node] = None

    def _condition_changes(self, name: str) -> None:
        self._scoped.condition_changes(name, self.revision(name))
        for changes in self._followers:
            changes.conditions[name] = None

    def _nodes_change(self, *nodes: int) -> None:
        for changes in self._followers:
            changes.nodes.update(dict.fromkeys(nodes))

    def _described(self, robot: str, member: Member, incarnation: Incarnation) -> None:
        known = self.members.get(robot)
        if known is None or known[0].capabilities != member.capabilities:
            self._nodes_change(*self._failed_at)
        self.members[robot] = (member, incarnation)
        self._claim_changes(robot)

    def _claimed(self, robot: str, claim: Claim | NoClaim, incarnation: Incarnation) -> None:
        self._claim_changes(robot)
        if isinstance(claim, NoClaim):
            self.claims.pop(robot, None)
            return
        self.claims[robot] = (claim, incarnation)
        self._claim_changes(robot)
        self.max_stamp = max(self.max_stamp, claim.since)

    def _claim_changes(self, robot: str) -> None:
        """By the paper's policy a claim, as long as it is valid, counts as an assignment."""
        if self._tree_reads_claims and robot in self.claims:
            try:
                self._nodes_change(parse_activation(self.claims[robot][0].activation).node)
            except ValueError:
                return  # of nothing that a tree could name

    def _bids_change(self, activation: str, old: Entry | None, new: Entry | None) -> None:
        change = (new.hash if new else 0) - (old.hash if old else 0)
        state = self._bid_states.pop(activation, 0) + change
        if state:
            self._bid_states[activation] = state

    def _ended(self, parts: tuple[str, ...], entry: Entry, outcome: Outcome) -> None:
        self.outcome_changes += 1
        if len(parts) == 4:
            token = CoalitionId.parse(parts[3])
            self._coalition(parts).add_outcome(token, parts[2], entry, outcome.success)
        else:
            tasks = self.outcomes.get(parts[1], {})
            ends = {**tasks.get(parts[2], {}), entry.author: outcome.success}
            self.outcomes[parts[1]] = {**tasks, parts[2]: ends}
            self._count_successes(parts[1])

    def _count_successes(self, activation: str) -> None:
        task = self.mission.global_tasks[self._scoped.by_scope[activation].name.subject]
        outcomes = self.outcomes.get(activation, {})
        if all(sum(outcomes.get(n.local_task, {}).values()) >= n.min_robots for n in task.needs):
            self._succeeded.add(activation)
        else:
            self._succeeded.discard(activation)

    def _latched(self, entry: Entry, record: Attempt | Latch | ChildResult) -> None:
        match record:
            case Attempt(number=number) | ChildResult(success=number):
                self._latches.setdefault(entry.name, {})[entry.author] = int(number)
            case Latch():
                self._latches.setdefault(entry.name, {})[entry.author] = 1

    def _coalition(self, parts: tuple[str, ...]) -> Coalitions:
        return self._coalitions.setdefault(parts[1], Coalitions())

    def _forget(self, parts: tuple[str, ...], author: str) -> None:
        """Only scoped entries are ever dropped, those of one activation all together."""
        if parts[0] in records.COALITION_KINDS or len(parts) == 4:
            self._coalitions.pop(parts[1], None)
            return
        if parts[0] == records.OUTCOME:
            tasks = dict(self.outcomes[parts[1]])
            ends = {robot: x for robot, x in tasks.pop(parts[2]).items() if robot != author}
            if ends:
                tasks[parts[2]] = ends
            if tasks:
                self.outcomes[parts[1]] = tasks
                self._count_successes(parts[1])
            else:
                del self.outcomes[parts[1]]
                self._succeeded.discard(parts[1])
            return
        if parts[0] == records.BID:
            self._bids.pop((parts[1], parts[2]), None)
            return
        name = "/".join(parts)
        del self._latches[name][author]
        if not self._latches[name]:
            del self._latches[name]
