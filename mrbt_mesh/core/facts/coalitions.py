"""Coalitions: robots that start one activation together, and how they end.

A task that is `simultaneous` or `exclusive` is carried out by coalitions. The leader, the first
robot that the plan assigns to the activation, writes down the robots that are ready, and all of
them start. A coalition has succeeded once every local task has nu successes *of its members*. If a
member drops out and too few are left, it is broken: the rest stop, and a new one is formed.

For an exclusive task a coalition needs the leases of a majority (`membership.leases`). One that had
a lease and ended without outcomes leaves the activation in doubt.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from mrbt_mesh.core.facts.records import (
    BROKEN,
    CLAIM,
    CLEARED,
    DOUBT,
    GRANT,
    Claim,
    Coalition,
    CoalitionId,
    CoalitionMember,
    Decision,
    OperatorCommand,
    Phase,
)
from mrbt_mesh.core.facts.store import Entry, FactMap, Incarnation, Version
from mrbt_mesh.core.mission.mission import GlobalTask


def majority(grantors: Collection[str]) -> int:
    """The number of leases that a coalition needs."""
    return len(grantors) // 2 + 1


@dataclass(slots=True)
class Coalitions:
    """The facts about one activation's coalitions, by their ids.

    `outcomes`: by coalition, local task and robot. `broken`, `grants`, `doubts` and `cleared`:
    their authors. `doubts` and `ended` also have versions: of the entry with which an author
    doubted the coalition, or wrote its outcome. `decisions`: those of operators.
    """

    members: dict[CoalitionId, tuple[CoalitionMember, ...]] = field(default_factory=dict)
    outcomes: dict[CoalitionId, dict[str, dict[str, bool]]] = field(default_factory=dict)
    broken: dict[CoalitionId, set[str]] = field(default_factory=dict)
    grants: dict[CoalitionId, set[str]] = field(default_factory=dict)
    doubts: dict[CoalitionId, dict[str, Version]] = field(default_factory=dict)
    ended: dict[CoalitionId, dict[str, Version]] = field(default_factory=dict)
    cleared: dict[CoalitionId, set[str]] = field(default_factory=dict)
    decisions: dict[CoalitionId, Decision] = field(default_factory=dict)

    def add(self, kind: str, coalition: CoalitionId, entry: Entry) -> None:
        """Add a fact about a coalition."""
        if isinstance(entry.record, Coalition):
            self.members[coalition] = entry.record.members
        elif isinstance(entry.record, OperatorCommand):
            self.decisions[coalition] = Decision(entry.record.value)
        elif kind == DOUBT:
            self.doubts.setdefault(coalition, {})[entry.author] = entry.version
        else:
            latches = {BROKEN: self.broken, GRANT: self.grants, CLEARED: self.cleared}
            latches[kind].setdefault(coalition, set()).add(entry.author)

    def add_outcome(
        self, coalition: CoalitionId, local_task: str, robot: str, success: bool, version: Version
    ) -> None:
        """Add a member's outcome of a local task."""
        self.outcomes.setdefault(coalition, {}).setdefault(local_task, {})[robot] = success
        self.ended.setdefault(coalition, {})[robot] = version

    def outcome(self, coalition: CoalitionId, member: CoalitionMember) -> bool | None:
        """A member's success or failure, None while it has neither."""
        return self.outcomes.get(coalition, {}).get(member.local_task, {}).get(member.robot)

    def failed_robots(self, local_task: str) -> set[str]:
        """The robots that have failed at a local task in any coalition."""
        return {
            robot
            for found in self.outcomes.values()
            for robot, success in found.get(local_task, {}).items()
            if not success
        }

    def is_resolved(self, coalition: CoalitionId) -> bool:
        """True if all members of this coalition have an outcome."""
        members = self.members.get(coalition, ())
        return bool(members) and all(self.outcome(coalition, m) is not None for m in members)

    def is_open(self, coalition: CoalitionId) -> bool:
        """True if the work may be half done: outcomes are missing, and it may not begin again."""
        return not self.is_resolved(coalition) and not self.may_begin_again(coalition)

    def may_begin_again(self, coalition: CoalitionId) -> bool:
        """True if the work counts as not begun: it never was, or an operator decided to retry."""
        return coalition in self.cleared or self.decisions.get(coalition) is Decision.RETRY

    def in_doubt(self, grantors: Collection[str]) -> list[CoalitionId]:
        """Coalitions that have ended and left the activation in doubt, in canonical order.

        The doubt of a member that has stopped is enough. Otherwise the leases of so many grantors
        must have expired that the rest are not a majority. A member whose outcome came before its
        doubt counts only as a grantor: the members still at work cannot renew its lease if it does
        not hear them.
        """
        needed = len(grantors) - majority(grantors) + 1
        found = []
        for coalition in sorted(self.doubts):
            doubts, ended = self.doubts[coalition], self.ended.get(coalition, {})
            members = {coalition.leader, *(m.robot for m in self.members.get(coalition, ()))}
            has_stopped = any(
                author not in ended or doubts[author] <= ended[author]
                for author in members & doubts.keys()
            )
            is_lost = has_stopped or len(doubts.keys() & set(grantors)) >= needed
            if self.is_open(coalition) and is_lost:
                found.append(coalition)
        return found

    def unended(self, grantors: Collection[str]) -> list[CoalitionId]:
        """The coalitions that were written down and have not ended, in canonical order."""
        ended = {*self.broken, *self.in_doubt(grantors)}
        unended = (c for c in self.members if c not in ended and not self.may_begin_again(c))
        return sorted(unended)

    def round_number(self, grantors: Collection[str], at_work: CoalitionId | None) -> int:
        """The number of coalitions that ended without success, before any that is at work."""
        ended = {*self.broken, *self.in_doubt(grantors)}
        return sum(at_work is None or coalition < at_work for coalition in ended)


class CoalitionFacts(Protocol):
    """The part of the team's facts that the functions below read."""

    @property
    def map(self) -> FactMap: ...
    @property
    def grantors(self) -> frozenset[str]: ...
    def coalitions(self, activation: str) -> Coalitions: ...


def is_still_in(
    facts: CoalitionFacts, coalition: CoalitionId, member: CoalitionMember, activation: str
) -> bool:
    """True if a member without an outcome still holds the claim with which it was ready.

    An older claim does not mean that it dropped out: the newer one has not arrived here yet.
    """
    entry = facts.map.get(member.robot, CLAIM)
    listed = Version(Incarnation(member.counter, member.nonce), member.sequence)
    if entry is None or entry.version < listed:
        return True
    claim = entry.record
    return (
        entry.version.incarnation == listed.incarnation
        and isinstance(claim, Claim)
        and (claim.activation, claim.since) == (activation, member.since)
        and claim.coalition in ("", str(coalition))
    )


def coalition_at_work(
    facts: CoalitionFacts, task: GlobalTask, activation: str, alive: Mapping[str, Incarnation]
) -> CoalitionId | None:
    """The first coalition, in canonical order, that has enough members left.

    There may be two after a partition has healed. A coalition of an exclusive task stays until its
    leases have expired, since it may be at work out of reach.
    """
    for coalition in facts.coalitions(activation).unended(facts.grantors):
        if task.exclusive or _has_enough(facts, task, activation, coalition, alive):
            return coalition
    return None


def newly_broken(
    facts: CoalitionFacts,
    task: GlobalTask,
    activation: str,
    alive: Mapping[str, Incarnation],
    me: str,
) -> list[CoalitionId]:
    """Coalitions with too few members left, and those that have to give way to an earlier one.

    Only members consider the alive set: a coalition out of other robots' reach may still be at
    work.
    """
    found = facts.coalitions(activation)
    at_work = coalition_at_work(facts, task, activation, alive)
    broken = []
    for coalition in found.unended(facts.grantors):
        is_member = any(member.robot == me for member in found.members[coalition])
        known_alive = alive if is_member else None
        has_enough = _has_enough(facts, task, activation, coalition, known_alive)
        if not has_enough or (at_work is not None and coalition > at_work):
            broken.append(coalition)
    return broken


def _has_enough(
    facts: CoalitionFacts,
    task: GlobalTask,
    activation: str,
    coalition: CoalitionId,
    alive: Mapping[str, Incarnation] | None,
) -> bool:
    """True if nu members of each local task have succeeded or still take part.

    `alive` None: dead or not.
    """
    found = facts.coalitions(activation)
    left = dict.fromkeys((need.local_task for need in task.needs), 0)
    for member in found.members[coalition]:
        outcome = found.outcome(coalition, member)
        incarnation = Incarnation(member.counter, member.nonce)
        is_alive = alive is None or alive.get(member.robot) == incarnation
        stays = outcome is None and is_alive and is_still_in(facts, coalition, member, activation)
        left[member.local_task] += bool(outcome) or stays
    return all(left[need.local_task] >= need.min_robots for need in task.needs)


def ready_members(
    facts: CoalitionFacts, activation: str, robots: Mapping[str, str]
) -> list[CoalitionMember]:
    """Return the robots (robot -> local task) that are ready for this activation, sorted by id."""
    ready = []
    for robot in sorted(robots):
        entry = facts.map.get(robot, CLAIM)
        claim = entry.record if entry is not None else None
        if (
            entry is not None
            and isinstance(claim, Claim)
            and claim.phase is Phase.READY
            and (claim.activation, claim.local_task) == (activation, robots[robot])
        ):
            (counter, nonce), sequence = entry.version
            member = CoalitionMember(robot, claim.local_task, counter, nonce, sequence, claim.since)
            ready.append(member)
    return ready


def are_enough(task: GlobalTask, members: Collection[CoalitionMember]) -> bool:
    """True if there are nu members for each local task."""
    tasks = [member.local_task for member in members]
    return all(tasks.count(need.local_task) >= need.min_robots for need in task.needs)
