"""Deliberate bugs, each as a switch: what the chaos runs must not let pass.

with MUTATIONS["join_keeps_older"]():
    ...  # the product is broken
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any
from unittest import mock

from mrbt_mesh.core import assignment, demand, plan
from mrbt_mesh.core.agent import Agent
from mrbt_mesh.core.effects import Persist
from mrbt_mesh.core.facts import Entry, FactMap, Incarnation
from mrbt_mesh.core.membership import Membership
from mrbt_mesh.core.records import ConditionValue, Outcome
from mrbt_mesh.core.replica import Replica
from mrbt_mesh.core.team import TeamFacts

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

    with mock.patch("mrbt_mesh.core.facts.join", join):
        yield


@mutation
def unsorted_workers() -> Iterator[None]:
    """Robots are taken in the order in which a set has them, which differs between robots."""

    def workers(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> dict[str, demand.Worker]:
        found = original(facts, alive)
        return {robot: found[robot] for robot in alive if robot in found}

    original = demand.workers
    with mock.patch.object(plan, "workers", workers):
        yield


@mutation
def no_pins() -> Iterator[None]:
    """Whoever runs something may be given something else."""

    def unpinned(*args: Any) -> demand.Demand:
        return replace(original(*args), pinned=())

    original = demand._demand
    with mock.patch.object(demand, "_demand", unpinned):
        yield


@mutation
def revision_not_bumped() -> Iterator[None]:
    """A condition that changes keeps its revision, and the first writer wins."""

    def same_revision(self: Agent, conditions: Any) -> list[tuple[str, list[Any]]]:
        writes = original(self, conditions)
        return [
            (name, [value, max(1, revision - 1), stamp])
            for name, (value, revision, stamp) in writes
        ]

    original = Agent._condition_writes
    with mock.patch.object(Agent, "_condition_writes", same_revision):
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

    blind: dict[int, dict[tuple[str, str], int]] = {}
    original, digests = FactMap.merge, FactMap.author_digests
    with (
        mock.patch.object(FactMap, "merge", merge),
        mock.patch.object(FactMap, "author_digests", author_digests),
    ):
        yield


@mutation
def starts_without_agreement() -> Iterator[None]:
    """A robot starts as soon as its own plan says so."""
    with mock.patch.object(Membership, "agrees", return_value=True):
        yield


@mutation
def any_optimum() -> Iterator[None]:
    """Whatever optimum the solver finds is taken, not the canonical one."""

    def last(problem: assignment.AssignmentProblem, optimum: Sequence[int]) -> tuple[int, ...]:
        return tuple(optimum)

    with mock.patch.object(assignment, "canonical", last):
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
def prunes_what_is_current() -> Iterator[None]:
    """Outcomes are dropped although they can still be reached."""

    def drops(self: Any, name: Any, facts: Any) -> bool:
        return original(self, name, facts) or bool(facts.outcome_changes % 7 == 6)

    from mrbt_mesh.core.evaluate import Evaluator

    original = Evaluator.is_obsolete

    def prune(self: TeamFacts, evaluator: Any) -> int:
        with mock.patch.object(Evaluator, "is_obsolete", drops):
            return prune_originally(self, evaluator)

    prune_originally = TeamFacts.prune
    with mock.patch.object(TeamFacts, "prune", prune):
        yield
