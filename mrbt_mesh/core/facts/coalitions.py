"""Coalitions: robots that start one activation together, and what becomes of them.

A task that is `simultaneous` or `exclusive` is carried out by coalitions. The leader, the first
robot that the plan has on the activation, writes down who was ready, and all of them start. A
coalition has succeeded once every local task has nu successes *of its members*; when a member
drops out and too few are left, it is broken, the rest stop, and a new one is formed.

For an exclusive task a coalition needs grants (`grants`); one that got some and ended without
outcomes leaves the activation in doubt.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
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
    Phase,
)
from mrbt_mesh.core.facts.store import Entry, FactMap, Incarnation, Version
from mrbt_mesh.core.mission.mission import FailurePolicy, GlobalTask, InDoubtPolicy, Need


def majority(grantors: Collection[str]) -> int:
    """How many grants a coalition needs."""
    return len(grantors) // 2 + 1


@dataclass(slots=True)
class Coalitions:
    """What the facts say of one activation's coalitions.

    `outcomes` are by token, local task and robot. `broken`, `grants`, `doubts` and `cleared`
    hold the authors who said so; `doubts` and `ended` when, by an author's own count, it doubted
    the coalition and had its outcome.
    """

    members: dict[CoalitionId, tuple[CoalitionMember, ...]] = field(default_factory=dict)
    outcomes: dict[CoalitionId, dict[str, dict[str, bool]]] = field(default_factory=dict)
    broken: dict[CoalitionId, set[str]] = field(default_factory=dict)
    grants: dict[CoalitionId, set[str]] = field(default_factory=dict)
    doubts: dict[CoalitionId, dict[str, Version]] = field(default_factory=dict)
    ended: dict[CoalitionId, dict[str, Version]] = field(default_factory=dict)
    cleared: dict[CoalitionId, set[str]] = field(default_factory=dict)

    def add(self, kind: str, token: CoalitionId, entry: Entry) -> None:
        """Take in what an author has said of a coalition."""
        if isinstance(entry.record, Coalition):
            self.members[token] = entry.record.members
        elif kind == DOUBT:
            self.doubts.setdefault(token, {})[entry.author] = entry.version
        else:
            latches = {BROKEN: self.broken, GRANT: self.grants, CLEARED: self.cleared}
            latches[kind].setdefault(token, set()).add(entry.author)

    def add_outcome(self, token: CoalitionId, local_task: str, entry: Entry, success: bool) -> None:
        """Take in how a local task ended for a member."""
        ends = self.outcomes.setdefault(token, {}).setdefault(local_task, {})
        ends[entry.author] = success
        self.ended.setdefault(token, {})[entry.author] = entry.version

    def has_succeeded(self, task: GlobalTask) -> bool:
        """Whether one coalition has nu successes of each local task."""
        return any(
            all(sum(found.get(n.local_task, {}).values()) >= n.min_robots for n in task.needs)
            for found in self.outcomes.values()
        )

    def outcome(self, token: CoalitionId, member: CoalitionMember) -> bool | None:
        """Success or failure of a member, None while it has neither."""
        return self.outcomes.get(token, {}).get(member.local_task, {}).get(member.robot)

    def failed_robots(self, local_task: str) -> set[str]:
        """Robots that have failed at a local task, in whichever coalition."""
        return {
            robot
            for found in self.outcomes.values()
            for robot, success in found.get(local_task, {}).items()
            if not success
        }

    def is_resolved(self, token: CoalitionId) -> bool:
        """Whether all members of this coalition have said how it ended."""
        members = self.members.get(token, ())
        return bool(members) and all(self.outcome(token, m) is not None for m in members)

    def is_open(self, token: CoalitionId) -> bool:
        """Whether a granted coalition's work may be half done: no outcomes, and not cleared."""
        return not self.is_resolved(token) and token not in self.cleared

    def in_doubt(self, grantors: Collection[str]) -> list[CoalitionId]:
        """Coalitions that have ended and left the activation in doubt, in canonical order.

        The word of a member that stopped is enough; otherwise so many givers have let their
        grants run out that those that are left are no majority. A member that had its outcome
        before is only a giver: those that are still at it cannot renew its grant if it does not
        hear them.
        """
        needed = len(grantors) - majority(grantors) + 1
        found = []
        for token in sorted(self.doubts):
            doubts, ended = self.doubts[token], self.ended.get(token, {})
            members = {token.leader, *(m.robot for m in self.members.get(token, ()))}
            stopped = any(
                author not in ended or doubts[author] <= ended[author]
                for author in members & doubts.keys()
            )
            if self.is_open(token) and (stopped or len(doubts.keys() & set(grantors)) >= needed):
                found.append(token)
        return found

    def unended(self, grantors: Collection[str]) -> list[CoalitionId]:
        """The coalitions that were written down and have not ended, in canonical order."""
        ended = {*self.broken, *self.cleared, *self.in_doubt(grantors)}
        return sorted(token for token in self.members if token not in ended)

    def round_number(self, grantors: Collection[str], at_work: CoalitionId | None) -> int:
        """How many coalitions have ended without success, before the one at work if there is."""
        ended = {*self.broken, *self.in_doubt(grantors)}
        return sum(at_work is None or token < at_work for token in sorted(ended))

    def has_failed(
        self, task: GlobalTask, able: Callable[[str], Collection[str]], grantors: Collection[str]
    ) -> bool:
        """Whether the task has failed; `able` are the known robots capable of a local task.

        Resilient: fewer than nu capable robots have not failed yet. Paper: in one coalition
        the failures exceed the members less nu.
        """
        if task.in_doubt is InDoubtPolicy.FAIL and self.in_doubt(grantors):
            return True
        return any(self._need_failed(task, need, able) for need in task.needs)

    def _need_failed(
        self, task: GlobalTask, need: Need, able: Callable[[str], Collection[str]]
    ) -> bool:
        failed = self.failed_robots(need.local_task)
        if not failed:
            return False
        if task.failure is FailurePolicy.RESILIENT:
            return len(set(able(need.local_task)) - failed) < need.min_robots
        for token, members in self.members.items():
            ends = [self.outcome(token, m) for m in members if m.local_task == need.local_task]
            if ends.count(False) > len(ends) - need.min_robots:
                return True
        return False


class CoalitionFacts(Protocol):
    """What judging coalitions reads of the team's facts."""

    @property
    def map(self) -> FactMap: ...
    @property
    def grantors(self) -> frozenset[str]: ...
    def coalitions(self, activation: str) -> Coalitions: ...


def is_still_in(
    facts: CoalitionFacts, token: CoalitionId, member: CoalitionMember, activation: str
) -> bool:
    """Whether a member without an outcome still holds the claim with which it was ready.

    A claim that is older than that has only not been replaced here yet.
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
        and claim.coalition in ("", str(token))
    )


def coalition_at_work(
    facts: CoalitionFacts, task: GlobalTask, activation: str, alive: Mapping[str, Incarnation]
) -> CoalitionId | None:
    """The coalition at work: the first that has enough members left.

    There are two after a partition has healed; the canonical order decides. That of an
    exclusive task stands until its grants have run out: it may be at work out of reach.
    """
    for token in facts.coalitions(activation).unended(facts.grantors):
        if task.exclusive or _has_enough(facts, task, activation, token, alive):
            return token
    return None


def newly_broken(
    facts: CoalitionFacts,
    task: GlobalTask,
    activation: str,
    alive: Mapping[str, Incarnation],
    me: str,
) -> list[CoalitionId]:
    """Coalitions with too few members left, and those that lost a conflict.

    Only members judge by who is alive; for others a coalition out of reach may well go on.
    """
    found = facts.coalitions(activation)
    at_work = coalition_at_work(facts, task, activation, alive)
    broken = []
    for token in found.unended(facts.grantors):
        judges = any(member.robot == me for member in found.members[token])
        enough = _has_enough(facts, task, activation, token, alive if judges else None)
        if not enough or (at_work is not None and token > at_work):
            broken.append(token)
    return broken


def _has_enough(
    facts: CoalitionFacts,
    task: GlobalTask,
    activation: str,
    token: CoalitionId,
    alive: Mapping[str, Incarnation] | None,
) -> bool:
    """Whether nu members of each local task have succeeded or are still in (None: dead or not)."""
    found = facts.coalitions(activation)
    left = dict.fromkeys((need.local_task for need in task.needs), 0)
    for member in found.members[token]:
        outcome = found.outcome(token, member)
        life = Incarnation(member.counter, member.nonce)
        present = alive is None or alive.get(member.robot) == life
        stays = outcome is None and present and is_still_in(facts, token, member, activation)
        left[member.local_task] += bool(outcome) or stays
    return all(left[need.local_task] >= need.min_robots for need in task.needs)


def ready_members(
    facts: CoalitionFacts, activation: str, robots: Mapping[str, str]
) -> list[CoalitionMember]:
    """Those of `robots` (robot -> local task) that are ready for this activation, by id."""
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
    """Whether there are nu members for each local task."""
    tasks = [member.local_task for member in members]
    return all(tasks.count(need.local_task) >= need.min_robots for need in task.needs)
