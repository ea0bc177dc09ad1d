"""Deliberate bugs, each as a switch: what the chaos runs must not let pass.

with MUTATIONS["join_keeps_older"]():
    ...  # the product is broken
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any
from unittest import mock
from weakref import WeakKeyDictionary

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.commands import Answer, Commands
from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.effects import Persist
from mrbt_mesh.core.agent.lifecycle import Lifecycle
from mrbt_mesh.core.agent.operator_messages import CommandStep, command_version, operate_body
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.agent.wall_clock import WallClock
from mrbt_mesh.core.assignment import canonical, problem
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import Guard, Guards
from mrbt_mesh.core.bt.tree import Kind, Node
from mrbt_mesh.core.facts import jobs, store
from mrbt_mesh.core.facts.activation_facts import ActivationFacts
from mrbt_mesh.core.facts.jobs import Jobs
from mrbt_mesh.core.facts.records import Arguments, ConditionValue, Outcome
from mrbt_mesh.core.facts.store import Entry, FactMap, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.feature import NAMES
from mrbt_mesh.core.membership.anti_entropy import AntiEntropy
from mrbt_mesh.core.membership.joining import Joining
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.replica import Durability, Replica
from mrbt_mesh.core.mission.mission import FailurePolicy
from mrbt_mesh.core.planning import capabilities, demands, make_plan, schedules

Patch = tuple[Any, str, Callable[..., Any]]
MUTATIONS: dict[str, Callable[[], contextlib.AbstractContextManager[None]]] = {}


def add(name: str, *patches: Patch) -> None:
    """A mutation: each function takes a place, and gets the original as its first argument."""

    @contextlib.contextmanager
    def broken() -> Iterator[None]:
        with contextlib.ExitStack() as stack:
            for target, attribute, function in patches:
                original = getattr(target, attribute)
                replacement = _with_original(function, original)
                stack.enter_context(mock.patch.object(target, attribute, replacement))
            yield

    MUTATIONS[name] = broken


def _with_original(function: Callable[..., Any], original: Any) -> Callable[..., Any]:
    return lambda *given, **named: function(original, *given, **named)


def mutation(target: Any, attribute: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A mutation of one place, by the name of the function."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        add(function.__name__, (target, attribute, function))
        return function

    return register


def always(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value


# Robots stop when they are done, also where the mission never ends.
add("every_mission_ends", (Lifecycle, "_stands_by", always(False)))
# Heartbeats do not name the robots that their sender hears: there is no indirect probe.
add("no_relays", (Membership, "relays", always({})))
# A robot starts as soon as its own plan is made.
add("starts_without_agreement", (Membership, "all_report_plan", always(True)))
# Leases are given, and exclusive tasks begun, before the facts that they rest on are on the disk.
add("promises_before_synced", (Durability, "is_on_disk", always(True)))
# A schedule may have tasks before those that they come after in the tree.
add("schedules_against_the_tree", (schedules, "precedence", always({})))
# Nothing is kept of a job that has ended: late news begins it again.
add("ended_jobs_are_forgotten", (jobs, "_is_kept", always(False)))
# Operators' cancellations and ends of jobs do not keep robots from them.
add("ended_jobs_go_on", (Jobs, "has_ended", always(False)))
# Steps of jobs that are held begin.
add("held_jobs_go_on", (demands, "_held", lambda _, group, __: group))
# A robot has failed, and the others that could still try are dead: no failure is ever declared.
add("the_dead_are_waited_for", (make_plan, "pending_failures", always({})))


@mutation(Joining, "is_done")
def alone_begins_at_once(original: Any, joining: Joining, *given: Any) -> bool:
    """A robot that has heard nobody waits no longer than one that misses some."""
    joining.alone_until_us = joining.gathers_until_us
    return bool(original(joining, *given))


@mutation(WallClock, "compare")
def wrong_clocks_are_believed(original: Any, clock: WallClock, now_us: int) -> bool:
    """A robot goes by its own clock, however far it is from the others'."""
    changed = bool(original(clock, now_us))
    clock.is_believed = True
    return changed


@mutation(store, "join")
def join_keeps_older(_: Any, mine: Entry | None, other: Entry) -> Entry:
    """Of two entries with one key, the first one is kept."""
    return mine or other


@mutation(capabilities, "workers")
def unsorted_workers(
    original: Any, facts: TeamFacts, alive: Mapping[str, Incarnation]
) -> dict[str, capabilities.Worker]:
    """Robots are taken in the order in which a set has them, which differs between robots."""
    found = original(facts, alive)
    return {robot: found[robot] for robot in alive if robot in found}


@mutation(demands, "_demand")
def no_pins(original: Any, *given: Any) -> demands.Demand:
    """A robot that runs something may be given something else."""
    return replace(original(*given), pinned=())


@mutation(Reports, "_changed_conditions")
def changes_not_counted(original: Any, mine: Reports, *given: Any) -> dict[str, ConditionValue]:
    """A condition that changes keeps its count, and the first writer wins."""
    changed = original(mine, *given)
    return {n: replace(v, changes=max(1, v.changes - 1)) for n, v in changed.items()}


@mutation(ActivationFacts, "add")
def arguments_are_read_anew(original: Any, mine: ActivationFacts, entry: Entry) -> None:
    """Each robot takes the arguments of the moment at which it begins itself."""
    if isinstance(entry.record, Arguments):
        mine.keys[entry.author, entry.name] = None
    else:
        original(mine, entry)


@mutation(Replica, "restore")
def outcomes_dropped_at_restart(original: Any, mine: Replica, entries: Sequence[Entry]) -> None:
    """A robot that starts again leaves the outcomes in its journal out."""
    original(mine, [entry for entry in entries if not isinstance(entry.record, Outcome)])


# Of each replica: the hashes of its conditions.
_blind = WeakKeyDictionary[FactMap, dict[tuple[str, str], int]]()


def _merge(original: Any, mine: FactMap, entries: Any) -> list[Entry]:
    changed: list[Entry] = original(mine, entries)
    for entry in changed:
        if isinstance(entry.record, ConditionValue):
            _blind.setdefault(mine, {})[entry.author, entry.name] = entry.hash
    return changed


def _author_digests(original: Any, mine: FactMap) -> dict[str, bytes]:
    totals = {author: int.from_bytes(d, "big") for author, d in original(mine).items()}
    for (author, _), number in _blind.get(mine, {}).items():
        totals[author] = (totals.get(author, 0) - number) % (1 << 128)
    return {a: totals[a].to_bytes(16, "big") for a in sorted(totals) if totals[a]}


def _digest(_: Any, mine: FactMap) -> bytes:
    return hashlib.blake2b(repr(mine.author_digests()).encode(), digest_size=8).digest()


# The digest of a replica leaves conditions out.
add(
    "digest_ignores_conditions",
    (FactMap, "merge", _merge),
    (FactMap, "author_digests", _author_digests),
    (FactMap, "digest", _digest),
)


@mutation(AntiEntropy, "peers_to_ask")
def no_repair(
    original: Any, mine: AntiEntropy, now_us: int, own: Collection[bytes] = ()
) -> list[str]:
    """Only a robot that joins asks for facts that it has missed."""
    original(mine, now_us, own)
    return []


@mutation(canonical, "canonical")
def any_optimum(
    _: Any, problem: problem.AssignmentProblem, optimum: Sequence[int]
) -> tuple[int, ...]:
    """The solver's own optimum is taken, not the canonical one."""
    return tuple(optimum)


@mutation(make_plan, "look_ahead")
def schedules_by_arrival(original: Any, facts: TeamFacts, *given: Any) -> schedules.Lookahead:
    """The schedule in force is the one that has come first, not the best one."""
    found = original(facts, *given)
    for author, proposal in facts.proposals.items():
        if proposal.steps and found.schedule is not None:
            schedule = found.mended(proposal).schedule
            course = schedules.course_of(found.problem, schedule)
            return replace(found, schedule=schedule, course=course, author=author)
    return found


@mutation(Agent, "handle")
def told_before_synced(original: Any, mine: Agent, event: Any, now_us: int) -> list[Any]:
    """A batch goes out to the team before it is in the journal."""
    effects = original(mine, event, now_us)
    return sorted(effects, key=lambda effect: isinstance(effect, Persist))


@mutation(TeamFacts, "prune")
def prunes_what_is_current(prune: Any, mine: TeamFacts) -> Any:
    """Outcomes are dropped although they can still be reached."""
    original = Evaluator.is_obsolete

    def drops(self: Any, name: Any, facts: Any) -> bool:
        return original(self, name, facts) or bool(facts.outcome_changes % 7 == 6)

    with mock.patch.object(Evaluator, "is_obsolete", drops):
        return prune(mine)


@mutation(Commands, "carry_out")
def garbled_commands_pause(
    original: Any, mine: Commands, body: Any, now_us: int
) -> Answer | AwaitedAnswer:
    """A command that no robot understands pauses the team, to be on the safe side."""
    answer: Answer | AwaitedAnswer = original(mine, body, now_us)
    if not isinstance(answer, AwaitedAnswer) and not answer[0]:
        version = command_version(mine._context.facts.max_stamp + 1, "garbled")
        pause = make_command("paused", "pause", "", version, mine._context.facts.run, None)
        mine._desk.take(operate_body(CommandStep.WRITE, pause), now_us)
    return answer


@mutation(capabilities, "_is_same")
def losses_are_overlooked(
    _: Any, worker: capabilities.Worker, other: capabilities.Worker | None
) -> bool:
    """The capabilities of a robot are looked up once, and not again when they change."""
    return other is not None and worker.incarnation == other.incarnation


@mutation(Guards, "read_before")
def guards_are_counted_one_by_one(
    _: Any, guards: Guards, node: Node, position: int
) -> tuple[Guard, ...]:
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


@mutation(Guards, "read_before")
def compound_conditions_guard_nothing(
    original: Any, mine: Guards, node: Node, position: int
) -> tuple[Guard, ...]:
    """Nodes behind several conditions that decide together are never carried out again."""
    return tuple(guard for guard in original(mine, node, position) if guard[0][0] != "#")


@mutation(make_plan, "pending_failures")
def the_dead_count_as_assigned(original: Any, facts: TeamFacts, requests: Any, *given: Any) -> Any:
    """By the paper's count a dead robot's claim is an assignment for ever."""
    tasks = facts.mission.global_tasks
    return {
        index: failure
        for index, failure in original(facts, requests, *given).items()
        if tasks[requests[index].subject].failure is not FailurePolicy.PAPER
    }


for feature in NAMES:
    for name, patch in import_module(f"tests.features.{feature}.mutants").MUTANTS.items():
        add(name, *(patch if isinstance(patch, list) else [patch]))
