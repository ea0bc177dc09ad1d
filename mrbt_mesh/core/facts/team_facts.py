"""The team's facts: the map of entries of one mission and run, and how the team reads it.

`TeamFacts` keeps the indices for all readers and gives T_G its `EvaluationFacts`. For the rules see
the package's docstring.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple, TypeVar

from mrbt_mesh.core.bt.activation import Activation, parse_activation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.activation_facts import ActivationFacts, Outcomes
from mrbt_mesh.core.facts.conditions import Conditions
from mrbt_mesh.core.facts.jobs import Jobs, guard_number, job_of
from mrbt_mesh.core.facts.records import (
    Attempt,
    Claim,
    ConditionValue,
    ExpressionChanges,
    JobArchive,
    JobEnd,
    Member,
    MissionResult,
    NoClaim,
    OperatorCommand,
    Overtaken,
    Phase,
    Proposal,
    Record,
    RobotProblem,
    TeamOrder,
    TeamTime,
    TravelTimes,
    stamp_of,
)
from mrbt_mesh.core.facts.stamps import Counts, Stamps
from mrbt_mesh.core.facts.store import Change, Entry, FactMap, Incarnation, Version
from mrbt_mesh.core.facts.task_status import task_status
from mrbt_mesh.core.facts.validation import ACTIVATION_KINDS, believed, task_of_activation
from mrbt_mesh.core.feature import Index, JointFacts, features, overrides
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.jobs import OpenJob, place_at, with_jobs
from mrbt_mesh.core.mission.mission import GlobalTask, Mission, performance
from mrbt_mesh.core.mission.names import type_name

_Index = TypeVar("_Index", bound=Index)
# Kinds of facts that may belong to jobs, besides those of activations.
OF_JOBS = records.JOB_KINDS | {records.CONDITION, records.EXPRESSION}
# Stands for an activation of which nothing is known.
_NOTHING = ActivationFacts(Activation("", -1, "", (), 0))


class KnownMember(NamedTuple):
    """A robot's description, and the incarnation that wrote it."""

    member: Member
    incarnation: Incarnation


class KnownClaim(NamedTuple):
    """A robot's claim, and the incarnation that made it."""

    claim: Claim
    incarnation: Incarnation


def capability(member: Member, local_task: str) -> int | None:
    """p(i, l) of a member in micro-units; None if it cannot do the task at all, or not now."""
    if member.lost or member.pending:
        names = local_task, type_name(local_task)
        if any(name in member.lost or name in member.pending for name in names):
            return None
    return performance(member.capabilities, local_task)


def changed_performances(mission: Mission, robot: str, member: Member) -> dict[str, int]:
    """The performances of a robot that differ from the mission's, in micro-units."""
    known = mission.robots.get(robot)
    declared = known.capabilities if known else mission.robot_types.get(member.type, {})
    return {n: v for n, v in sorted(member.capabilities.items()) if declared.get(n) != v}


class TeamFacts:
    """The replicated facts of one run of one mission, indexed.

    `in_force`: the mission in force, as in its file. `jobs`: None if the mission has no job types.
    `indexes`: those of features, by class. `activations`: name -> the facts of the activation.
    `problems`: robot -> its journal or a part of its program -> what is wrong with it. `changes`
    counts all changes of the map, `outcome_changes` those of outcomes. `me`: the robot that holds
    the facts, if any.
    """

    def __init__(self, mission: Mission, run: str, me: str = "") -> None:
        self.run = run
        self.me = me
        self.map = FactMap()
        self._stamps = Stamps(me)
        self._counts = Counts()
        self.changes = 0
        self.outcome_changes = 0
        # Robots that an earlier mission named but the one in force does not: they have left.
        self.removed_robots: frozenset[str] = frozenset()
        self._begin(mission)
        # Authors whose facts are ignored: see `set_revoked`.
        self.revoked: frozenset[str] = frozenset()
        self.map.subscribe(self._index)

    def _begin(self, mission: Mission) -> None:
        """Start with empty indices for this mission."""
        self.in_force = mission
        self.members: dict[str, KnownMember] = {}
        self.claims: dict[str, KnownClaim] = {}
        self.conditions = Conditions(mission)
        self.activations: dict[str, ActivationFacts] = {}
        self.problems: dict[str, dict[str, str]] = {}
        self.proposals: dict[str, Proposal] = {}
        self.jobs = Jobs(mission) if mission.jobs else None
        self.travel_times: dict[str, TravelTimes] = {}
        # Robot -> how often it has overtaken which activations; robot -> its last reported time.
        self.overtakings: dict[str, Overtaken] = {}
        self.team_times: dict[str, TeamTime] = {}
        self._mission = mission
        # The jobs in `_mission`'s tree; None: the tree still has the job types.
        self._in_tree: tuple[OpenJob, ...] | None = None
        self._places: dict[str, str] = {}
        # (robot, its type) -> its travel times, for robots that have published some.
        self._travel_tables: dict[tuple[str, str], Sequence[Sequence[int]]] = {}
        self._order, self._is_aborted = TeamOrder.RESUME, False
        # The indices of features: by class; and by the kind of entry.
        self.indexes: dict[type[Index], Index] = {}
        self._index_of: dict[str, Index] = {}
        for feature in features():
            if (index := feature.index(mission)) is not None:
                self.indexes[type(index)] = index
                kinds = *feature.activation_kinds(), *feature.other_kinds()
                self._index_of |= dict.fromkeys(kinds, index)
        indexes = self.indexes.values()
        self._successors = [i.successor for i in indexes if overrides(i, Index, "successor")]
        self._droppers = [i.obsolete for i in indexes if overrides(i, Index, "obsolete")]
        self._results: dict[str, MissionResult] = {}
        # Entries that are ignored while this mission is in force, and whether `prune` must check
        # them.
        self._unbelieved: dict[tuple[str, str], Entry] = {}
        self._may_drop_unbelieved = False
        # What `prune` must check: all activations, if some may have become reachable or
        # unreachable, or else the new ones.
        self._has_reach_changed = False
        self._new_activations: dict[str, None] = {}

    def begin_with(self, mission: Mission) -> None:
        """Read facts by another mission of this team from now on. There must be no facts yet."""
        assert not len(self.map)
        self._begin(mission)
        self.changes += 1

    def _take_up(self, mission: Mission) -> None:
        """Put another mission of the team in force: read all facts by it."""
        self.removed_robots = (self.removed_robots | self.in_force.robot_ids) - mission.robot_ids
        self._begin(mission)
        self.changes += 1
        self.outcome_changes += 1
        for entry in self.map:
            self._believe(None, entry)
        self._has_reach_changed = True

    def set_revoked(self, authors: frozenset[str]) -> None:
        """Ignore the facts of exactly these authors, whose keys were revoked, from now on."""
        if authors == self.revoked:
            return
        self.revoked = authors
        self._begin(self.in_force)
        self.changes += 1
        self.outcome_changes += 1
        for entry in self.map:
            self._believe(None, entry)
        self._has_reach_changed = True

    @property
    def mission(self) -> Mission:
        """The mission with the trees of open jobs in its tree."""
        self._follow_jobs()
        return self._mission

    def _follow_jobs(self) -> None:
        if self.jobs is not None and self.jobs.has_changed:
            before, self._in_tree = self._in_tree, self.jobs.in_tree()
            if before != self._in_tree:
                self._mission = with_jobs(self.in_force, self._in_tree)
                self.conditions.use(self._mission)

    # -- what T_G reads: EvaluationFacts ------------------------------------------------------

    def condition(self, name: str) -> bool:
        """True if the condition holds."""
        return self.conditions.value(name)

    def condition_of(self, robot: str, name: str) -> bool:
        """True if the condition holds for a robot: its own one if every robot has its own."""
        return self.conditions.of_robot(robot, name)

    def entry(self, robot: str, name: str, job: str = "") -> Value | None:
        """The value of a blackboard entry, by the name that a robot's program uses in a task of
        this job; None if it is not set.
        """
        return self.conditions.entry(self.in_force.entries.of(robot, name, job))

    def turns(self, name: str, value: bool) -> int:
        """How often the condition or expression has changed to `value`."""
        return self.conditions.turns(name, value)

    def turned_guards(self) -> list[tuple[str, ExpressionChanges]]:
        """The guards of several nodes whose value has changed here and must be recorded."""
        self._follow_jobs()
        return self.conditions.unnoted() or self.conditions.turned_with_actions(self)

    def task_status(self, subject: str, activation: str) -> Status:
        """The status of a global task. RUNNING until its activation has a result."""
        said = self.activations.get(activation)
        if said is None:
            return Status.RUNNING
        task = self.mission.global_tasks.get(subject) or self.task(activation)
        return task_status(task, said, self)

    def status_after(self, name: str, robot: str, success: bool, version: Version) -> Status:
        """The status of an activation once this outcome of a robot is added to the facts."""
        parts = tuple(name.split("/"))
        after = ActivationFacts(parse_activation(parts[1]))
        said = self.activations.get(parts[1])
        for key in said.keys if said is not None else ():
            entry = self.map.get(*key)
            assert entry is not None
            after.add(entry)
        known = self.map.get(robot, name)
        if known is None or known.record.rank() < success:
            after.add_outcome(parts, robot, success, version)
        return task_status(self.task(parts[1]), after, self)

    def attempts_used(self, activation: str) -> int:
        """The number of attempts used up, over all authors."""
        return self._said(activation).attempts_used

    def has_expired(self, activation: str) -> bool:
        """True if any robot has seen this Timeout's deadline pass."""
        return self._said(activation).has_expired

    def child_result(self, activation: str, position: int) -> Status | None:
        """How this child of a node with memory ended, None if unknown. Success takes precedence."""
        success = self._said(activation).child_results.get(position)
        if success is None:
            return None
        return Status.SUCCESS if success else Status.FAILURE

    def jobs_status(self, origin: int) -> Status:
        """RUNNING, or how one of its jobs ended this Jobs node."""
        return self.jobs.node_status(origin) if self.jobs is not None else Status.RUNNING

    # -- features -----------------------------------------------------------------------------

    def index(self, kind: type[_Index]) -> _Index:
        """The index of a feature in this mission, by the class of the index. Raises KeyError if the
        feature has none.
        """
        found = self.indexes[kind]
        assert isinstance(found, kind)
        return found

    def index_of(self, entry: Entry) -> Index | None:
        """The index of the feature that an entry is of, if it has one."""
        return self._index_of.get(entry.parts[0])

    def idle(self, reasons: Mapping[str, str]) -> Mapping[str, str]:
        """Return better reasons, from features, why some of these robots are idle."""
        better: dict[str, str] = {}
        for index in self.indexes.values():
            better |= index.idle(reasons)
        return better

    # -- robots -------------------------------------------------------------------------------

    def valid_claim(self, robot: str) -> Claim | None:
        """The robot's claim if it was made by the robot's newest incarnation, else None."""
        held, known = self.claims.get(robot), self.members.get(robot)
        return held.claim if held and known and held.incarnation == known.incarnation else None

    def claimants(self, activation: str, local_task: str) -> list[str]:
        """The robots with a valid claim on this local task of this activation."""
        claims = ((robot, self.valid_claim(robot)) for robot in self.claims)
        wanted = (activation, local_task)
        return [robot for robot, c in claims if c and (c.activation, c.local_task) == wanted]

    def by_share(self, robots: Iterable[str]) -> list[str]:
        """Sort robots for a choice between equals: those that worked on fewer of the last jobs
        first, then by id.
        """
        if self.jobs is None or not self.jobs.shares:
            return sorted(robots)
        shares = self.jobs.shares
        return sorted(robots, key=lambda robot: (shares.get(robot, 0), robot))

    def robots_with(self, local_task: str) -> list[str]:
        """All known robots with the capability, including dead robots and robots that lost it."""
        members = self.members.items()
        return [r for r, known in members if performance(known.member.capabilities, local_task)]

    def place_of(self, robot: str) -> str:
        """Where the robot is, or where it has set out from, dead or not; empty if nobody knows, and
        in missions without places.
        """
        travel = self.mission.travel
        if travel is None:
            return ""
        return self._places.get(robot) or travel.start.get(robot, "")

    def under_way(self, robot: str) -> str:
        """The place that the robot is travelling to; empty if it is not travelling."""
        travel, claim = self.mission.travel, self.valid_claim(robot)
        if travel is None or claim is None or claim.phase is not Phase.TRAVELLING:
            return ""
        return place_at(self.in_force, claim.local_task)

    def travel_table(self, robot: str) -> Sequence[Sequence[int]]:
        """The robot's travel times in ms, as in `Travel.table`: those of its program if published,
        else those that the mission declares.
        """
        travel, kind = self.mission.travel, self.members[robot].member.type
        assert travel is not None
        said = self.travel_times.get(robot)
        if said is None:
            return travel.table(kind)
        found = self._travel_tables.get((robot, kind))
        if found is None:
            found = travel.changed_table(kind, said.places, said.ways_ms)
            self._travel_tables[robot, kind] = found
        return found

    def overtaken(self, activation: str) -> int:
        """How often robots have begun a later task before this activation."""
        return sum(each.counts.get(activation, 0) for each in self.overtakings.values())

    @property
    def max_stamp(self) -> int:
        """The greatest Lamport stamp (Lamport 1978) that counts. A robot writes the next one."""
        return self._stamps.greatest

    def is_too_far_ahead(self, entry: Entry) -> bool:
        """True if the author claims more changes of a condition, or more attempts, than are
        possible.

        Every authentic entry must be passed to this before it is merged.
        """
        author, name = entry.author, entry.name
        match entry.record:
            case ConditionValue(changes=changes):
                known = partial(self.conditions.counts, entry.parts[1])
                return self._counts.is_too_far_ahead(name, author, changes, known)
            case Attempt(number):
                known = partial(self._attempts_by_author, entry.parts[1])
                return self._counts.is_too_far_ahead(name, author, number, known)
        return False

    def _attempts_by_author(self, activation: str) -> dict[str, int]:
        keys = self._said(activation).keys
        entries = [self.map.get(*key) for key in keys if key[1].startswith(records.ATTEMPT)]
        return {e.author: e.record.number for e in entries if e and isinstance(e.record, Attempt)}

    def order(self) -> TeamOrder:
        """The operators' standing order: abort if it was ever given, else the newest order; RESUME
        if there is none.
        """
        return TeamOrder.ABORT if self._is_aborted else self._order

    def result(self, alive: Collection[str]) -> Status | None:
        """How the mission has ended, None if it has not. Success takes precedence over failure.

        A result that half of the robots or fewer agreed on counts only while no more of them are
        alive.
        """
        if not self._results:
            return None
        robots = self.mission.robots
        present = min(sum(robot in robots for robot in alive), len(robots) // 2 + 1)
        standing = [each.success for each in self._results.values() if each.agreed >= present]
        if not standing:
            return None
        return Status.SUCCESS if any(standing) else Status.FAILURE

    def begun_with(self, activation: str) -> bool:
        """True if the blackboard values with which this activation began are a fact."""
        return self._said(activation).begun_with is not None

    def values_read(self, activation: str, task: GlobalTask) -> tuple[str | None, ...]:
        """The values of the entries that a task reads, as arguments and sorted by name: those with
        which the activation began, or else the present ones. None for an entry that is not set.
        """
        begun = self._said(activation).begun_with
        if begun is not None:
            return begun[2]
        job = parse_activation(activation).job
        found = []
        for read in task.reads:
            value = self.entry("", read, job)
            found.append(None if value is None else self.in_force.entries.text(read, value))
        return tuple(found)

    # -- activations of global tasks ----------------------------------------------------------

    def _said(self, activation: str) -> ActivationFacts:
        """What is known of an activation. Read-only."""
        return self.activations.get(activation, _NOTHING)

    def task_of(self, activation: str) -> GlobalTask | None:
        """The global task of an activation, None if the mission in force has no such step."""
        try:
            found = parse_activation(activation)
        except ValueError:
            return None
        return task_of_activation(found, self.in_force)

    def task(self, activation: str) -> GlobalTask:
        """The global task of an activation that a robot works on, or has worked on."""
        found = self.task_of(activation)
        assert found is not None
        return found

    def has_latched_failure(self, activation: str) -> bool:
        """True if the failure of this activation has been latched."""
        return self._said(activation).has_latched_failure

    def outcomes(self, activation: str) -> Outcomes:
        """Local task -> robot -> success, for a task whose robots work each on its own.

        Returns the same object until an outcome changes.
        """
        return self._said(activation).outcomes

    def results(self, activation: str, local_task: str) -> Mapping[str, bool]:
        """Robot -> success, for the outcomes of one local task that count now."""
        said = self._said(activation)
        if said.joint is None:
            return said.outcomes.get(local_task, {})
        return said.joint.results(local_task, self)

    def has_outcome(self, activation: str) -> bool:
        """True if some robot has an outcome in this activation."""
        return self._said(activation).has_outcome

    def joint(self, activation: str) -> JointFacts | None:
        """What is known of the parties to an activation; None: nothing."""
        return self._said(activation).joint

    # -- what may be dropped ------------------------------------------------------------------

    def prune(self) -> list[tuple[str, str]]:
        """Drop the facts of activations that no evaluation can reach any more, and of ended jobs.

        Every replica drops the same facts. Returns (author, name) pairs, sorted. Dropping
        unreachable facts does not make any others unreachable.
        """
        keys = self.obsolete(self.activations if self._has_reach_changed else self._new_activations)
        for author, name in keys:
            self.map.drop(author, name)
        self._has_reach_changed = self._may_drop_unbelieved = False
        self._new_activations.clear()
        return keys

    def obsolete(self, activations: Collection[str]) -> list[tuple[str, str]]:
        """(author, name) of the facts of these activations, of jobs and of features that nothing
        reads any more, sorted.
        """
        found = [self.activations[name] for name in activations if name in self.activations]
        obsolete = [each for each in found if self.is_obsolete(each.activation)]
        keys = [key for each in obsolete for key in each.keys]
        for dropped in self._droppers:
            keys += dropped()
        if self._may_drop_unbelieved:
            keys += [key for key, entry in self._unbelieved.items() if self.is_past(entry)]
        return sorted([*keys, *(self.jobs.obsolete if self.jobs is not None else ())])

    def is_obsolete(self, activation: Activation) -> bool:
        """True if no evaluation can reach this activation any more, now or later."""
        job = activation.job
        if job and self.jobs is not None and self.jobs.has_ended(job):
            return self.jobs.is_settled(job)
        return self.mission.evaluator.is_obsolete(activation, self)

    def unbelieved(self) -> Iterator[Entry]:
        """The facts that are ignored while the mission in force lacks what they are about."""
        return iter(self._unbelieved.values())

    def is_past(self, entry: Entry) -> bool:
        """True if no revision can have a place for this fact, which is not believed: it belongs to
        an ended job, or to a part of an earlier tree that is no longer known.
        """
        succession, kind = self.in_force.succession, entry.parts[0]
        name = "/".join(entry.parts[1:2])
        if kind in ACTIVATION_KINDS:
            activation = parse_activation(name)
            number, job = activation.node, activation.job
        elif kind in (records.CONDITION, records.EXPRESSION):
            number, job = guard_number(name), job_of(entry)
        else:
            return False
        if job:
            return self.jobs is not None and self.jobs.is_settled(job)
        return number >= 0 and succession is not None and not succession.keeps_number(number)

    def is_recorded(self, robot: str) -> bool:
        """True unless the robot has reported that it does not record what it does."""
        return records.RECORDING not in self.problems.get(robot, {})

    # -- keeping the indices ------------------------------------------------------------------

    def _believe(self, old: Entry | None, new: Entry) -> None:
        """Index a fact if the mission in force has a place for it, else keep it as unbelieved."""
        key = (new.author, new.name)
        was_believed = old is not None and self._unbelieved.pop(key, None) is None
        record: Record | None = new.record
        if self.in_force.succession is not None and new.parts[0] not in records.IN_ANY_MISSION:
            record = believed(new, self.in_force, self.run)
            self._see_stamp(new)
        if new.author in self.revoked:
            record = None
        if record is None:
            if old is not None and was_believed:
                self._forget(old)
            self._unbelieved[key] = new
            self._may_drop_unbelieved = True
        else:
            self._add(new if record is new.record else replace(new, record=record))

    def _see_stamp(self, entry: Entry) -> None:
        """Note the stamp of an entry; for a command, the one given by the operator's client."""
        is_command = isinstance(entry.record, OperatorCommand)
        stamp = entry.version.incarnation.counter if is_command else stamp_of(entry.record)
        self._stamps.see(entry.author, stamp)

    def _forget(self, entry: Entry) -> None:
        """Remove an entry whose author has replaced it by one that is not believed."""
        author, kind, name = entry.author, entry.parts[0], "/".join(entry.parts[1:2])
        if kind == records.SCHEDULE:
            self.proposals.pop(author, None)
        elif kind == records.TRAVEL_TIMES:
            self.travel_times.pop(author, None)
            self._travel_tables.clear()
        elif kind in OF_JOBS:
            if self.jobs is not None and job_of(entry):
                self.jobs.remove(entry)
            if kind == records.CONDITION:
                self.conditions.drop(name, author)
            elif kind == records.EXPRESSION:
                self.conditions.forget(name, author)

    def _index(self, changes: Sequence[Change]) -> None:
        for old, new in changes:
            self.changes += 1
            if new is not None:
                self._believe(old, new)
            elif old is not None:
                self._remove(old)
        found = [mission for successor in self._successors if (mission := successor()) is not None]
        if found:
            self._take_up(found[0])

    def _add(self, entry: Entry) -> None:
        kind = entry.parts[0]
        if kind in (records.CONDITION, records.EXPRESSION, records.ATTEMPT):
            self._has_reach_changed = True
        if self.jobs is not None and kind in OF_JOBS:
            self._add_to_job(entry, self.jobs)
        if kind in ACTIVATION_KINDS:
            self._add_to_activation(entry)
        elif (index := self._index_of.get(kind)) is not None:
            index.add(entry)
        elif isinstance(entry.record, OperatorCommand):
            self._add_command(kind, entry.record)
        else:
            self._add_record(entry)
        if isinstance(entry.record, OperatorCommand):
            self._see_stamp(entry)

    def _add_command(self, field: str, command: OperatorCommand) -> None:
        """Add a command to the team."""
        match field:
            case records.PAUSED:
                self._order = TeamOrder(command.value)
            case records.ABORTED:
                self._is_aborted = True

    def _add_record(self, entry: Entry) -> None:
        author, record, incarnation = entry.author, entry.record, entry.version.incarnation
        match record:
            case Member():
                self.members[author] = KnownMember(record, incarnation)
            case Claim():
                self._note_claim(author, record)
                self.claims[author] = KnownClaim(record, incarnation)
                self._places[author] = record.place
                self._stamps.see(author, record.since)
            case NoClaim(place):
                self._note_claim(author, None)
                self.claims.pop(author, None)
                self._places[author] = place
            case ConditionValue():
                self.conditions.set(entry.parts[1], author, record)
                self._stamps.see(author, record.stamp)
            case ExpressionChanges():
                self.conditions.note(entry.parts[1], author, record)
            case MissionResult():
                self._results[author] = record
            case RobotProblem(text):
                self._add_problem(author, entry.parts[1], text)
            case JobArchive() if self.jobs is not None:
                self.jobs.add_archive(entry, record)
            case Proposal() | TravelTimes() | Overtaken() | TeamTime():
                self._add_about_ways(author, record)

    def _add_to_job(self, entry: Entry, jobs: Jobs) -> None:
        jobs.add(entry)
        if isinstance(entry.record, JobEnd):
            self._stamps.see(entry.author, entry.record.stamp)
            self._may_drop_unbelieved = bool(self._unbelieved)
        if jobs.is_settled(entry.parts[1]) and entry.parts[1] in jobs.known:
            ended = jobs.known[entry.parts[1]].activations
            self._new_activations |= dict.fromkeys(ended)

    def _note_claim(self, robot: str, claim: Claim | None) -> None:
        """Update how many robots work on the jobs of a robot's old and new claim."""
        if self.jobs is None:
            return
        held = self.claims.get(robot)
        for each, by in ((held.claim if held else None, -1), (claim, 1)):
            job = parse_activation(each.activation).job if each is not None else ""
            if each is not None and job and each.phase is Phase.RUNNING:
                self.jobs.note_claims(job, by)

    def _add_about_ways(
        self, author: str, record: Proposal | TravelTimes | Overtaken | TeamTime
    ) -> None:
        match record:
            case Proposal():
                self.proposals[author] = record
            case TravelTimes():
                self.travel_times[author] = record
                self._travel_tables.clear()
            case Overtaken():
                self.overtakings[author] = record
            case TeamTime():
                self.team_times[author] = record

    def _add_problem(self, author: str, subject: str, text: str) -> None:
        known = self.problems.setdefault(author, {})
        known.pop(subject, None)
        if text:
            known[subject] = text

    def _add_to_activation(self, entry: Entry) -> None:
        kind, name = entry.parts[:2]
        said = self.activations.get(name)
        if said is None:
            said = self.activations[name] = ActivationFacts(parse_activation(name))
            self._new_activations[name] = None
            if said.activation.job and self.jobs is not None:
                self.jobs.note_activation(said.activation.job, name, is_known=True)
        said.add(entry)
        if (index := self._index_of.get(kind)) is not None:
            index.add(entry)
        self.outcome_changes += kind == records.OUTCOME
        self._note_result(said, entry, is_known=True)
        self._stamps.see(entry.author, said.stamp_of(entry))

    def _note_result(self, said: ActivationFacts, entry: Entry, is_known: bool) -> None:
        job, kind = said.activation.job, entry.parts[0]
        if job and self.jobs is not None and kind in records.RESULTS_IN_JOBS:
            self.jobs.note_result(job, entry, is_known)

    def _remove(self, entry: Entry) -> None:
        """Remove a dropped entry: of an activation (all of its entries go together), of a job, of
        a feature, or one that is not believed and so is in no index.
        """
        if self._unbelieved.pop((entry.author, entry.name), None) is not None:
            return
        index = self._index_of.get(entry.parts[0])
        if index is not None and entry.parts[0] not in ACTIVATION_KINDS:
            index.remove(entry)
            return
        name = entry.parts[1]
        if self.jobs is not None and entry.parts[0] == records.JOB_ARCHIVE:
            self.jobs.remove_archive(entry)
            return
        if self.jobs is not None and entry.parts[0] in OF_JOBS:
            self.jobs.remove(entry)
            if entry.parts[0] == records.EXPRESSION:
                self.conditions.forget(name, entry.author)
            elif entry.parts[0] == records.CONDITION:
                self.conditions.drop(name, entry.author)
            return
        said = self.activations[name]
        self._note_result(said, entry, is_known=False)
        if index is not None:
            index.remove(entry)
        del said.keys[entry.author, entry.name]
        if not said.keys:
            del self.activations[name]
            if said.activation.job and self.jobs is not None:
                self.jobs.note_activation(said.activation.job, name, is_known=False)
