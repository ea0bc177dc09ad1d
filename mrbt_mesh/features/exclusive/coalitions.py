"""Coalitions: robots that start one activation together, and how they end.

A task that is `simultaneous` or `exclusive` is carried out by coalitions. The leader, the first
robot that the plan assigns to the activation, writes down the robots that are ready, and all of
them start. A coalition has succeeded once every local task has nu successes *of its members*. If a
member drops out and too few are left, it is broken: the rest stop, and a new one is formed.

For an exclusive task a coalition needs the leases of a majority (`leases`). One that had
a lease and ended without outcomes leaves the activation in doubt.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from operator import itemgetter

from mrbt_mesh.core.facts.records import CLAIM, Claim, OperatorCommand, Phase
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version
from mrbt_mesh.core.facts.task_status import TeamMembers, are_enough
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.feature import JointFacts
from mrbt_mesh.core.mission.mission import FailurePolicy, GlobalTask, Need, majority
from mrbt_mesh.features.exclusive.fields import InDoubtPolicy, in_doubt_policy
from mrbt_mesh.features.exclusive.kinds import BROKEN, CLEARED, DOUBT, GRANT, Decision
from mrbt_mesh.features.exclusive.records import Coalition, CoalitionId, CoalitionMember


@dataclass(slots=True)
class Coalitions(JointFacts):
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

    def add(self, entry: Entry) -> None:
        kind, coalition = entry.parts[0], CoalitionId.parse(entry.parts[2])
        if isinstance(entry.record, Coalition):
            self.members[coalition] = entry.record.members
        elif isinstance(entry.record, OperatorCommand):
            self.decisions[coalition] = Decision(entry.record.value)
        elif kind == DOUBT:
            self.doubts.setdefault(coalition, {})[entry.author] = entry.version
        else:
            latches = {BROKEN: self.broken, GRANT: self.grants, CLEARED: self.cleared}
            latches[kind].setdefault(coalition, set()).add(entry.author)

    def stamp_of(self, entry: Entry) -> int:
        return CoalitionId.parse(entry.parts[2]).since

    def add_outcome(
        self, party: str, local_task: str, robot: str, success: bool, version: Version
    ) -> None:
        coalition = CoalitionId.parse(party)
        self.outcomes.setdefault(coalition, {}).setdefault(local_task, {})[robot] = success
        self.ended.setdefault(coalition, {})[robot] = version

    # -- how the activation ends --------------------------------------------------------------

    @property
    def has_outcome(self) -> bool:
        return bool(self.outcomes)

    @property
    def has_success(self) -> bool:
        ends = (each for found in self.outcomes.values() for each in found.values())
        return any(success for each in ends for success in each.values())

    @property
    def verdict(self) -> bool | None:
        decisions = self.decisions.values()
        if Decision.DONE in decisions:
            return True
        return False if Decision.FAILED in decisions else None

    def has_succeeded(self, task: GlobalTask) -> bool:
        """True if one coalition has succeeded, or an operator says that the task is done."""
        enough = any(are_enough(task, found) for found in self.outcomes.values())
        return enough or self.verdict is True

    def has_failed(self, task: GlobalTask, team: TeamMembers) -> bool:
        """True if one need has failed, or the activation is in doubt and the mission fails it then;
        or an operator says that it has failed.
        """
        if self.verdict is False:
            return True
        fails = in_doubt_policy(task) is InDoubtPolicy.FAIL
        if fails and self.in_doubt(team.in_force.robot_ids):
            return True
        return any(self._need_failed(task, need, team) for need in task.needs)

    def _need_failed(self, task: GlobalTask, need: Need, team: TeamMembers) -> bool:
        """True if a robot has failed and the failure policy counts that as a failure of the need.

        - `first`: nu is above 0;
        - `paper`: in one coalition the failures exceed its members - nu;
        - others: fewer than nu robots, dead or not, have not failed in any coalition.
        """
        failed = self.failed_robots(need.local_task)
        if not failed or task.failure is FailurePolicy.FIRST:
            return bool(failed) and need.min_robots > 0
        if task.failure is not FailurePolicy.PAPER:
            return len(set(team.robots_with(need.local_task)) - failed) < need.min_robots
        for coalition, members in self.members.items():
            there = [member for member in members if member.local_task == need.local_task]
            ends = [self.outcome(coalition, member) for member in there]
            if ends.count(False) > len(ends) - need.min_robots:
                return True
        return False

    def results(self, local_task: str, team: TeamMembers) -> Mapping[str, bool]:
        """The failures in all coalitions, and the successes in the first one that has not ended."""
        unended = self.unended(team.in_force.robot_ids)
        ends = self.outcomes.get(unended[0], {}) if unended else {}
        return dict.fromkeys(self.failed_robots(local_task), False) | {
            robot: True for robot, success in ends.get(local_task, {}).items() if success
        }

    def may_be_done(self) -> bool:
        if self.verdict is True or not self.grants:
            return self.verdict is True
        return self.has_success or any(map(self.is_open, self.grants))

    # -- one coalition ------------------------------------------------------------------------

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


def grantors(facts: TeamFacts) -> frozenset[str]:
    """The robots whose majority leases an exclusive task: all that the mission names."""
    return facts.in_force.robot_ids


def coalitions_of(facts: TeamFacts, activation: str) -> Coalitions:
    """What is known of the coalitions of one activation."""
    found = facts.joint(activation)
    return found if isinstance(found, Coalitions) else Coalitions()


def granted(facts: TeamFacts) -> list[tuple[str, Coalitions]]:
    """The activations for which some robot has granted a lease, sorted by name."""
    joint = ((name, said.joint) for name, said in facts.activations.items())
    known = ((name, found) for name, found in joint if isinstance(found, Coalitions))
    return sorted(((n, found) for n, found in known if found.grants), key=itemgetter(0))


def is_still_in(
    facts: TeamFacts, coalition: CoalitionId, member: CoalitionMember, activation: str
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
        and claim.party in ("", str(coalition))
    )


def coalition_at_work(
    facts: TeamFacts, task: GlobalTask, activation: str, alive: Mapping[str, Incarnation]
) -> CoalitionId | None:
    """The first coalition, in canonical order, that has enough members left.

    There may be two after a partition has healed. A coalition of an exclusive task stays until its
    leases have expired, since it may be at work out of reach.
    """
    for coalition in coalitions_of(facts, activation).unended(grantors(facts)):
        if task.at_most_once or _has_enough(facts, task, activation, coalition, alive):
            return coalition
    return None


def newly_broken(
    facts: TeamFacts,
    task: GlobalTask,
    activation: str,
    alive: Mapping[str, Incarnation],
    me: str,
) -> list[CoalitionId]:
    """Coalitions with too few members left, and those that have to give way to an earlier one.

    Only members consider the alive set: a coalition out of other robots' reach may still be at
    work.
    """
    found = coalitions_of(facts, activation)
    at_work = coalition_at_work(facts, task, activation, alive)
    broken = []
    for coalition in found.unended(grantors(facts)):
        is_member = any(member.robot == me for member in found.members[coalition])
        known_alive = alive if is_member else None
        has_enough = _has_enough(facts, task, activation, coalition, known_alive)
        if not has_enough or (at_work is not None and coalition > at_work):
            broken.append(coalition)
    return broken


def _has_enough(
    facts: TeamFacts,
    task: GlobalTask,
    activation: str,
    coalition: CoalitionId,
    alive: Mapping[str, Incarnation] | None,
) -> bool:
    """True if nu members of each local task have succeeded or still take part.

    `alive` None: dead or not.
    """
    found = coalitions_of(facts, activation)
    left = dict.fromkeys((need.local_task for need in task.needs), 0)
    for member in found.members[coalition]:
        outcome = found.outcome(coalition, member)
        incarnation = Incarnation(member.counter, member.nonce)
        is_alive = alive is None or alive.get(member.robot) == incarnation
        stays = outcome is None and is_alive and is_still_in(facts, coalition, member, activation)
        left[member.local_task] += bool(outcome) or stays
    return all(left[need.local_task] >= need.min_robots for need in task.needs)


def ready_members(
    facts: TeamFacts, activation: str, robots: Mapping[str, str]
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


def has_enough_members(task: GlobalTask, members: Collection[CoalitionMember]) -> bool:
    """True if there are nu members for each local task."""
    tasks = [member.local_task for member in members]
    return all(tasks.count(need.local_task) >= need.min_robots for need in task.needs)
