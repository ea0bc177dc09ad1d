"""Deliberate bugs, each as a switch: what the chaos runs must not let pass.

with MUTATIONS["join_keeps_older"]():
    ...  # the product is broken
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any
from unittest import mock

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.commands import Commands
from mrbt_mesh.core.agent.effects import Persist
from mrbt_mesh.core.agent.lifecycle import Lifecycle
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.assignment import canonical, problem
from mrbt_mesh.core.bt.guards import Guard, Guards
from mrbt_mesh.core.bt.tree import Kind, Node
from mrbt_mesh.core.facts import coalitions, task_status
from mrbt_mesh.core.facts.activation_facts import ActivationFacts
from mrbt_mesh.core.facts.records import GRANT, ConditionValue, OrderKind, Outcome
from mrbt_mesh.core.facts.store import Entry, FactMap, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership import leases
from mrbt_mesh.core.membership.anti_entropy import AntiEntropy
from mrbt_mesh.core.membership.leases import LeaseGrantor
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.replica import Durability, Replica
from mrbt_mesh.core.mission.mission import FailurePolicy, GlobalTask
from mrbt_mesh.core.planning import bids, capabilities, demands, make_plan

Mutation = Callable[[], contextlib.AbstractContextManager[Any]]
MUTATIONS: dict[str, Mutation] = {}


def mutation(function: Callable[[], Iterator[None]]) -> Callable[[], Iterator[None]]:
    MUTATIONS[function.__name__] = contextlib.contextmanager(function)
    return function


@mutation
def join_keeps_older() -> Iterator[None]:
    """Of two entries with one key, the one that was there first stands."""

    def join(mine: Entry | None, other: Entry) -> Entry:
        return mine or other

    with mock.patch("mrbt_mesh.core.facts.store.join", join):
        yield


@mutation
def every_mission_ends() -> Iterator[None]:
    """Robots stop when they are done, also where the mission says that it never ends."""
    with mock.patch.object(Lifecycle, "_stands_by", return_value=False):
        yield


@mutation
def unsorted_workers() -> Iterator[None]:
    """Robots are taken in the order in which a set has them, which differs between robots."""

    def workers(
        facts: TeamFacts, alive: Mapping[str, Incarnation]
    ) -> dict[str, capabilities.Worker]:
        found = original(facts, alive)
        return {robot: found[robot] for robot in alive if robot in found}

    original = capabilities.workers
    with mock.patch.object(capabilities, "workers", workers):
        yield


@mutation
def no_pins() -> Iterator[None]:
    """Whoever runs something may be given something else."""

    def unpinned(*args: Any) -> demands.Demand:
        return replace(original(*args), pinned=())

    original = demands._demand
    with mock.patch.object(demands, "_demand", unpinned):
        yield


@mutation
def revision_not_bumped() -> Iterator[None]:
    """A condition that changes keeps its revision, and the first writer wins."""

    def same_revision(self: Reports, conditions: Any) -> dict[str, ConditionValue]:
        changed = original(self, conditions)
        return {n: replace(v, revision=max(1, v.revision - 1)) for n, v in changed.items()}

    original = Reports._changed_conditions
    with mock.patch.object(Reports, "_changed_conditions", same_revision):
        yield


@mutation
def outcomes_dropped_at_restart() -> Iterator[None]:
    """A robot that starts again leaves the outcomes in its journal out."""

    def restore(self: Replica, entries: Sequence[Entry]) -> None:
        original(self, [entry for entry in entries if not isinstance(entry.record, Outcome)])

    original = Replica.restore
    with mock.patch.object(Replica, "restore", restore):
        yield


@mutation
def no_relays() -> Iterator[None]:
    """Beats do not say whom else their sender hears: there is no indirect probe."""
    with mock.patch.object(Membership, "relays", return_value={}):
        yield


@mutation
def digest_ignores_conditions() -> Iterator[None]:
    """The digest of a replica leaves conditions out."""

    def merge(self: FactMap, entries: Any) -> list[Entry]:
        changed = original(self, entries)
        for entry in changed:
            if isinstance(entry.record, ConditionValue):
                blind.setdefault(id(self), {})[entry.author, entry.name] = entry.hash
        return changed

    def author_digests(self: FactMap) -> dict[str, bytes]:
        totals = {author: int.from_bytes(d, "big") for author, d in digests(self).items()}
        for (author, _), number in blind.get(id(self), {}).items():
            totals[author] = (totals.get(author, 0) - number) % (1 << 128)
        return {a: totals[a].to_bytes(16, "big") for a in sorted(totals) if totals[a]}

    def digest(self: FactMap) -> bytes:
        return hashlib.blake2b(repr(author_digests(self)).encode(), digest_size=8).digest()

    blind: dict[int, dict[tuple[str, str], int]] = {}
    original, digests = FactMap.merge, FactMap.author_digests
    with (
        mock.patch.object(FactMap, "merge", merge),
        mock.patch.object(FactMap, "author_digests", author_digests),
        mock.patch.object(FactMap, "digest", digest),
    ):
        yield


@mutation
def stale_claims_stay_valid() -> Iterator[None]:
    """The claim of an earlier life still holds its robot in a coalition.

    (That of a robot without coalition ends with the batch with which its next life joins.)
    """

    def has_enough(
        facts: Any, task: Any, activation: str, token: Any, alive: Mapping[str, Incarnation] | None
    ) -> bool:
        members = facts.coalitions(activation).members[token]
        if alive is not None:
            lives = {m.robot: Incarnation(m.counter, m.nonce) for m in members}
            alive = {robot: lives.get(robot, life) for robot, life in alive.items()}
        return original(facts, task, activation, token, alive)

    original = coalitions._has_enough
    with (
        mock.patch.object(coalitions, "_has_enough", has_enough),
        mock.patch.object(coalitions, "is_still_in", return_value=True),
        mock.patch.object(demands, "is_still_in", return_value=True),
    ):
        yield


@mutation
def no_repair() -> Iterator[None]:
    """Nobody asks for what it has missed, but who joins."""

    def nobody(self: AntiEntropy, now_us: int) -> list[str]:
        original(self, now_us)
        return []

    original = AntiEntropy.peers_to_ask
    with mock.patch.object(AntiEntropy, "peers_to_ask", nobody):
        yield


@mutation
def starts_without_agreement() -> Iterator[None]:
    """A robot starts as soon as its own plan says so."""
    with mock.patch.object(Membership, "all_report_plan", return_value=True):
        yield


@mutation
def any_optimum() -> Iterator[None]:
    """Whatever optimum the solver finds is taken, not the canonical one."""

    def last(problem: problem.AssignmentProblem, optimum: Sequence[int]) -> tuple[int, ...]:
        return tuple(optimum)

    with mock.patch.object(canonical, "canonical", last):
        yield


@mutation
def bids_not_awaited() -> Iterator[None]:
    """The plan takes the bids that are there, and who has not spoken as a last resort."""

    def never_open(*args: Any) -> bids.Bidding:
        return replace(original(*args), is_open=False)

    original = bids._bidding
    with mock.patch.object(bids, "_bidding", never_open):
        yield


@mutation
def told_before_synced() -> Iterator[None]:
    """A batch goes out to the team before it is in the journal."""

    def handle(self: Agent, event: Any, now_us: int) -> list[Any]:
        effects = original(self, event, now_us)
        return sorted(effects, key=lambda effect: isinstance(effect, Persist))

    original = Agent.handle
    with mock.patch.object(Agent, "handle", handle):
        yield


@mutation
def promises_before_synced() -> Iterator[None]:
    """Leases are given, and exclusive tasks begun, before the disk has what they rest on."""
    with mock.patch.object(Durability, "is_on_disk", return_value=True):
        yield


@mutation
def prunes_what_is_current() -> Iterator[None]:
    """Outcomes are dropped although they can still be reached."""

    def drops(self: Any, name: Any, facts: Any) -> bool:
        return original(self, name, facts) or bool(facts.outcome_changes % 7 == 6)

    from mrbt_mesh.core.bt.evaluator import Evaluator

    original = Evaluator.is_obsolete

    def prune(self: TeamFacts) -> Any:
        with mock.patch.object(Evaluator, "is_obsolete", drops):
            return prune_originally(self)

    prune_originally = TeamFacts.prune
    with mock.patch.object(TeamFacts, "prune", prune):
        yield


@mutation
def exclusive_without_majority() -> Iterator[None]:
    """One grant is enough for an exclusive task."""
    with (
        mock.patch.object(coalitions, "majority", return_value=1),
        mock.patch.object(leases, "majority", return_value=1),
        mock.patch.object(demands, "majority", return_value=1),
    ):
        yield


@mutation
def grants_not_synced() -> Iterator[None]:
    """A robot forgets what it had granted when it starts again, and grants at once."""

    def restore(self: Replica, entries: Sequence[Entry]) -> None:
        original(self, [e for e in entries if not e.name.startswith(f"{GRANT}/")])

    def init(self: LeaseGrantor, *args: Any) -> None:
        init_originally(self, *args)
        self.end_silence()

    original, init_originally = Replica.restore, LeaseGrantor.__init__
    with (
        mock.patch.object(Replica, "restore", restore),
        mock.patch.object(LeaseGrantor, "__init__", init),
    ):
        yield


@mutation
def rounds_are_mixed() -> Iterator[None]:
    """Successes of different coalitions count together."""

    def has_succeeded(task: GlobalTask, said: ActivationFacts) -> bool:
        if said.coalitions is None:
            return original(task, said)
        outcomes = said.coalitions.outcomes.values()
        return all(
            sum(sum(found.get(n.local_task, {}).values()) for found in outcomes) >= n.min_robots
            for n in task.needs
        )

    original = task_status.has_succeeded
    with mock.patch.object(task_status, "has_succeeded", has_succeeded):
        yield


@mutation
def garbled_commands_pause() -> Iterator[None]:
    """A command that no robot understands lets the team rest, to be on the safe side."""

    def carry_out(mine: Commands, body: Any, now_us: int) -> tuple[bool, str]:
        good, text = original(mine, body, now_us)
        if not good:
            mine._reports.order(OrderKind.PAUSE, now_us)
        return good, text

    original = Commands.carry_out
    with mock.patch.object(Commands, "carry_out", carry_out):
        yield


@mutation
def losses_are_overlooked() -> Iterator[None]:
    """What a robot can do is looked up once, and not again when that changes."""

    def is_same(worker: capabilities.Worker, other: capabilities.Worker | None) -> bool:
        return other is not None and worker.incarnation == other.incarnation

    with mock.patch.object(capabilities, "_is_same", is_same):
        yield


@mutation
def guards_are_counted_one_by_one() -> Iterator[None]:
    """Each condition counts by itself, whether or not it decides anything."""
    with mock.patch.object(Guards, "read_before", _one_by_one):
        yield


def _one_by_one(guards: Guards, node: Node, position: int) -> tuple[Guard, ...]:
    """Each condition counts by itself, whether or not it decides anything."""
    if position == 0 or guards.has_memory[node.index] or node.kind is Kind.PARALLEL:
        return ()
    wanted = node.kind is Kind.SEQUENCE or (node.kind is Kind.IF_THEN_ELSE and position == 1)
    first = 0 if node.kind is Kind.IF_THEN_ELSE else position - 1
    return tuple(dict.fromkeys(_conditions_below(guards, node.children[first], wanted)))


def _conditions_below(guards: Guards, index: int, wanted: bool) -> Iterator[Guard]:
    node = guards.tree.nodes[index]
    if node.kind is Kind.CONDITION:
        yield node.subject, not wanted
    wanted ^= node.kind is Kind.INVERTER
    for child in node.children:
        yield from _conditions_below(guards, child, wanted)


@mutation
def compound_conditions_guard_nothing() -> Iterator[None]:
    """What stands behind several conditions that decide together is never done again."""

    def single(self: Guards, node: Node, position: int) -> tuple[Guard, ...]:
        return tuple(guard for guard in original(self, node, position) if guard[0][0] != "#")

    original = Guards.read_before
    with mock.patch.object(Guards, "read_before", single):
        yield


@mutation
def per_robot_conditions_are_anybodys() -> Iterator[None]:
    """Whoever is free goes on with what one robot has begun for itself."""
    with mock.patch.object(demands, "eligible", return_value=None):
        yield


@mutation
def the_dead_are_waited_for() -> Iterator[None]:
    """A robot has failed, and whoever could still try is dead: no verdict is ever due."""
    with mock.patch.object(make_plan, "pending_verdicts", return_value={}):
        yield


@mutation
def the_dead_count_as_assigned() -> Iterator[None]:
    """By the paper's count a dead robot's claim is an assignment for ever."""

    def pending(facts: TeamFacts, requests: Any, waiting: Any, *args: Any) -> Any:
        found = original(facts, requests, waiting, *args)
        tasks = facts.mission.global_tasks
        return {
            index: verdict
            for index, verdict in found.items()
            if tasks[requests[index].subject].failure is not FailurePolicy.PAPER
        }

    original = make_plan.pending_failures
    with mock.patch.object(make_plan, "pending_verdicts", pending):
        yield
