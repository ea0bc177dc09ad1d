"""The jobs of a team, as all robots read them from the facts.

An operator submits a job; the first submission under an id counts. Each field that operators change
later is a fact of its own, and so is the end of a job. An end written by one robot counts only if
other facts of the job support it. Once two robots have written it, those other facts are dropped,
except a cancellation. Of the oldest ends only hashes are kept, in archives, so that no job is done
again.
"""

from __future__ import annotations

import hashlib
from array import array
from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, NamedTuple

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    JOB_ARCHIVE,
    MAX_ARCHIVED,
    MAX_HASH,
    Hold,
    Job,
    JobArchive,
    JobEnd,
    JobState,
    Latch,
    OperatorCommand,
)
from mrbt_mesh.core.facts.store import Entry, Version
from mrbt_mesh.core.mission.jobs import OpenJob, jobs_nodes
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import owning_job

# The least number of ends that are kept, and the number of archives kept.
KEPT_ENDS = 500
KEPT_ARCHIVES = 200
# How many robots have to write a job's end before the job's other facts are dropped.
WITNESSES = 2
# How many recent ends count for the order in which robots with less work go first.
COUNTED_ENDS = 100
_KEPT = f"{records.JOB_END}/", f"{records.JOB_CANCELLED}/"


class JobKey(NamedTuple):
    """The canonical order of jobs: by larger priority, then by arrival."""

    minus_priority: int
    stamp: int
    id: str


@dataclass(slots=True)
class KnownJob:
    """Everything known under one job id.

    `keys`: (author, name) of its entries, and of guards in its tree. `commands`: field -> what
    operators have commanded. `activations`: those of its tree that facts are about; `claims`: how
    many robots work on it. It is begun if either is not empty. `results`: (author, name) -> entry,
    for outcomes and failures in its tree. `end_versions`: author -> the version of the end that it
    wrote. `witnesses`: how many robots have to write an end. `version`: how often its facts have
    changed.
    """

    id: str
    witnesses: int = WITNESSES
    version: int = 0
    keys: dict[tuple[str, str], None] = field(default_factory=dict)
    commands: dict[str, Entry] = field(default_factory=dict)
    ends: dict[str, JobEnd] = field(default_factory=dict)
    end_versions: dict[str, Version] = field(default_factory=dict)
    due: set[str] = field(default_factory=set)
    activations: dict[str, None] = field(default_factory=dict)
    results: dict[tuple[str, str], Entry] = field(default_factory=dict)
    claims: int = 0

    @property
    def is_begun(self) -> bool:
        """True if robots work on it, or have."""
        return self.claims > 0 or bool(self.activations)

    def _commanded(self, field: str) -> Any:
        """Return the value of a field, None if no operator has commanded one."""
        entry = self.commands.get(field)
        return entry.record.value if entry and isinstance(entry.record, OperatorCommand) else None

    def commanded_by(self, field: str) -> str:
        """Return the operator who last commanded a field; empty if nobody has."""
        entry = self.commands.get(field)
        return entry.record.operator if entry and isinstance(entry.record, OperatorCommand) else ""

    @property
    def job(self) -> Job | None:
        """The job, None if only other facts are known under its id."""
        found: Job | None = self._commanded(records.JOB)
        return found

    @property
    def arrival(self) -> int:
        """The stamp of its submission; 0 if that is not known."""
        entry = self.commands.get(records.JOB)
        return entry.version.incarnation.counter if entry is not None else 0

    @property
    def is_due(self) -> bool:
        """True if the job may begin as far as its start time is concerned."""
        job = self.job
        return bool(self.due) or (job is not None and not job.not_before_us)

    @property
    def hold(self) -> Hold:
        """Whether operators hold it."""
        return self._commanded(records.JOB_HOLD) or Hold.RELEASED

    @property
    def is_cancelled(self) -> bool:
        """True if an operator has cancelled it."""
        return records.JOB_CANCELLED in self.commands

    @property
    def has_ended(self) -> bool:
        """True if the job has ended or was cancelled, so that none of its tasks begins any more."""
        return self.is_cancelled or self.written_end is not None

    @property
    def written_end(self) -> JobEnd | None:
        """The end that robots have written and that counts; None if there is none."""
        found = [
            (-end.rank(), end.stamp, author)
            for author, end in self._possible_ends().items()
            if self.is_settled or self._is_shown(author, end)
        ]
        return self.ends[min(found)[2]] if found else None

    @property
    def is_settled(self) -> bool:
        """True if enough robots have written the job's end for its other facts to be dropped."""
        found = self._possible_ends()
        return bool(found) and (self.is_cancelled or len(found) >= self.witnesses)

    def _possible_ends(self) -> dict[str, JobEnd]:
        """Return author -> end. A written cancellation counts only with an operator's command."""
        if self.is_cancelled:
            return self.ends
        return {a: end for a, end in self.ends.items() if end.state is not JobState.CANCELLED}

    def _is_shown(self, author: str, end: JobEnd) -> bool:
        """True if other facts of the job support an end that one robot wrote: the job had a
        deadline; or it was due, and that robot had an outcome in it, or a failure in it was
        latched, or a timeout in it expired. So a robot that is alone can end a job that it has
        done.
        """
        if end.state is JobState.EXPIRED:
            return self.job is not None and bool(self.job.deadline_us)
        written, is_failure = self.end_versions[author], end.state is JobState.FAILED
        return self.is_due and any(
            (each.author == author and each.version <= written)
            or (is_failure and isinstance(each.record, Latch))
            for each in self.results.values()
        )

    @property
    def end(self) -> JobEnd | None:
        """How the job ended, None if it has not. A cancelled job may have been done nevertheless,
        by robots that had not heard of the cancellation (`done_all_the_same`).
        """
        end, job = self.written_end, self.job
        if not self.is_cancelled:
            return end
        if end is not None:
            return replace(end, state=JobState.CANCELLED)
        stamp = self.commands[records.JOB_CANCELLED].version.incarnation.counter
        if job is None:
            return None
        operator = self.commanded_by(records.JOB)
        return JobEnd(
            JobState.CANCELLED, job.type, job.arguments, operator, "", (), stamp, job.content
        )

    @property
    def done_all_the_same(self) -> tuple[str, ...]:
        """The robots that have done the job although it was cancelled, sorted."""
        end = self.written_end
        is_done = self.is_cancelled and end is not None and end.state is JobState.SUCCEEDED
        return end.robots if end is not None and is_done else ()

    @property
    def overruled_text(self) -> str:
        """A text on the robots that did a cancelled job; empty if none did."""
        robots = ", ".join(self.done_all_the_same)
        return f"done all the same by {robots}, which was cut off" if robots else ""

    @property
    def priority(self) -> int:
        """Its present priority."""
        job, changed = self.job, self._commanded(records.JOB_PRIORITY)
        submitted = job.priority if job is not None else 0
        return submitted if changed is None else changed


class Jobs:
    """The jobs of one mission by id, and which of them are in the mission's tree.

    For each type, the tree contains the jobs that are begun, and the next ones that are due and not
    held, up to the limit of the type's Jobs node. `obsolete`: (author, name) of entries of ended
    jobs that may be dropped. `witnesses`: how many robots have to write the end of a job.
    `arrived`: jobs submitted since this was last emptied.
    """

    def __init__(self, mission: Mission) -> None:
        self.known: dict[str, KnownJob] = {}
        self._mission = mission
        self.witnesses = min(WITNESSES, max(1, len(mission.robots)))
        self._node_of = jobs_nodes(mission)
        # Jobs that may be in the tree -> their type and key; type -> its keys in order.
        self._placed: dict[str, tuple[str, JobKey]] = {}
        self._open: dict[str, list[JobKey]] = {name: [] for name in self._node_of}
        self._begun: dict[str, dict[str, JobKey]] = {name: {} for name in self._node_of}
        self._ended_nodes: dict[int, Status] = {}
        self.obsolete: dict[tuple[str, str], None] = {}
        self.arrived: dict[str, None] = {}
        self._in_tree: tuple[OpenJob, ...] | None = None
        # Ended jobs -> their place in the order of ends: by the stamp of the end, then by id.
        self._ended: dict[str, tuple[int, str]] = {}
        self._by_end: list[tuple[int, str]] = []
        self._shares: Mapping[str, int] | None = None
        self._unended: dict[str, None] = {}
        # Cancelled jobs whose end no robot has written yet.
        self._cancelled: dict[str, None] = {}
        # Ended jobs whose end too few robots have written.
        self._unsettled: dict[str, None] = {}
        # Cancelled jobs that were done nevertheless.
        self._overruled: dict[str, None] = {}
        # (author, number) -> the archive; and all hashes of ids, sorted.
        self._archives: dict[tuple[str, str], JobArchive] = {}
        self._archived = array("Q")

    def __iter__(self) -> Iterator[KnownJob]:
        """All known jobs, by id."""
        return (self.known[name] for name in sorted(self.known))

    def count_open(self) -> int:
        """The number of jobs that have not ended."""
        return len(self._unended)

    @property
    def shares(self) -> Mapping[str, int]:
        """Robot -> how many of the last `COUNTED_ENDS` ended jobs it has worked on."""
        if self._shares is None:
            kept = (name for _, name in reversed(self._by_end) if not self.is_archived(name))
            ends = (self.known[name].written_end for name in islice(kept, COUNTED_ENDS))
            self._shares = Counter(robot for end in ends if end is not None for robot in end.robots)
        return self._shares

    def has_ended(self, name: str) -> bool:
        """True if this job is known to have ended."""
        known = self.known.get(name)
        return (known is not None and known.has_ended) or self.is_archived(name)

    def is_settled(self, name: str) -> bool:
        """True if this job has ended and its other facts may be dropped."""
        known = self.known.get(name)
        return (known is not None and known.is_settled) or self.is_archived(name)

    def hold_of(self, name: str) -> Hold:
        """Whether operators hold this job. An unknown job is not held."""
        known = self.known.get(name)
        return known.hold if known is not None else Hold.RELEASED

    def cancelled(self) -> list[KnownJob]:
        """The cancelled jobs whose end no robot has written yet, by id."""
        return [self.known[name] for name in sorted(self._cancelled)]

    def unsettled(self) -> list[KnownJob]:
        """The ended jobs whose end too few robots have written, by id."""
        return [self.known[name] for name in sorted(self._unsettled)]

    def overruled(self) -> list[KnownJob]:
        """The cancelled jobs that were done nevertheless, by id."""
        return [self.known[name] for name in sorted(self._overruled)]

    def count_archived(self) -> int:
        """The number of jobs known only by their hashes."""
        return len(self._archived)

    def is_archived(self, name: str) -> bool:
        """True if the job ended long ago and is in an archive."""
        return bool(self._archived) and self._has_hash(hash_of(name))

    def _has_hash(self, wanted: int) -> bool:
        place = bisect_left(self._archived, wanted)
        return place < len(self._archived) and self._archived[place] == wanted

    def archived_contents(self, name: str) -> set[int]:
        """The `Job.content` of a job in an archive; several if archives contradict each other."""
        wanted, found = hash_of(name), set()
        for archive in self._archives.values():
            place = bisect_left(archive.hashes, wanted)
            if place < len(archive.hashes) and archive.hashes[place] == wanted:
                found.add(archive.contents[place])
        return found

    def archived_end(self, name: str) -> JobState | None:
        """How a job in an archive ended. None if it is in no archive, if its end is not kept, or if
        archives contradict each other.
        """
        hashed = hash_of(name)
        found = {archive.end_of(hashed) for archive in self._archives.values()} - {None}
        return found.pop() if len(found) == 1 else None

    # -- archives -----------------------------------------------------------------------------

    def to_archive(self, turn: int) -> tuple[int, JobArchive] | None:
        """Return the next archive with its number, if there are enough ends for one.

        `turn`: how many robots should write it before this one.
        """
        if len(self._ended) <= KEPT_ENDS + (1 + turn) * MAX_ARCHIVED:
            return None
        settled = [name for name in self._ended if name not in self._unsettled]
        ends = ((name, self.known[name].end) for name in settled)
        oldest = sorted((e.stamp, name, e.content, e.state) for name, e in ends if e is not None)
        rows = {hash_of(name): (content, how) for _, name, content, how in oldest[:MAX_ARCHIVED]}
        hashes = sorted(rows)
        numbers = [int(name) for _, name in self._archives]
        contents = array("Q", [rows[each][0] for each in hashes])
        archive = JobArchive(
            array("Q", hashes), contents, "".join(rows[each][1][0] for each in hashes)
        )
        return max(numbers, default=0) + 1, archive

    def knows_archive(self, number: int, archive: JobArchive) -> bool:
        """True if all jobs in an archive are known to have ended, with the archive's contents, and
        its number is one of the next.
        """
        numbers = [int(name) for _, name in self._archives]
        if not archive.hashes or number > max(numbers, default=0) + KEPT_ARCHIVES:
            return False
        ends = ((name, self.known[name].written_end) for name in self._ended)
        ended = {(hash_of(name), end.content) for name, end in ends if end is not None}
        rows = zip(archive.hashes, archive.contents, strict=True)
        return all(row in ended or self._has_hash(row[0]) for row in rows)

    def add_archive(self, entry: Entry, archive: JobArchive) -> None:
        """Add an archive. All other entries of its jobs become obsolete."""
        self._archives[entry.author, entry.parts[1]] = archive
        self._archived = array("Q", sorted({*self._archived, *archive.hashes}))
        self._shares = None
        newly = frozenset(archive.hashes)
        for known in self.known.values():
            if hash_of(known.id) in newly:
                self.obsolete |= known.keys
        keys = sorted(self._archives, key=lambda key: (int(key[1]), key[0]))
        names = ((author, f"{JOB_ARCHIVE}/{number}") for author, number in keys[:-KEPT_ARCHIVES])
        self.obsolete |= dict.fromkeys(names)

    def remove_archive(self, entry: Entry) -> None:
        """Remove an archive that was dropped."""
        del self._archives[entry.author, entry.parts[1]]
        self.obsolete.pop((entry.author, entry.name), None)
        self._shares = None
        hashes = {number for each in self._archives.values() for number in each.hashes}
        self._archived = array("Q", sorted(hashes))

    def fits(self, job: Job) -> bool:
        """True if the mission has the job's type, which accepts its arguments. Otherwise an open
        job waits until a revision does.
        """
        kind = self._mission.jobs.get(job.type)
        return kind is not None and not kind.problem(job.arguments)

    def node_status(self, origin: int) -> Status:
        """RUNNING, or how a job whose type ends the mission ended a Jobs node."""
        return self._ended_nodes.get(origin, Status.RUNNING)

    # -- the jobs in the tree -----------------------------------------------------------------

    @property
    def has_changed(self) -> bool:
        """True if the jobs in the tree may have changed since the last call of `in_tree`."""
        return self._in_tree is None

    def in_tree(self) -> tuple[OpenJob, ...]:
        """The jobs whose trees belong in the mission's tree, in the canonical order."""
        if self._in_tree is None:
            keys: list[JobKey] = []
            for name, node in self._node_of.items():
                begun = self._begun[name]
                keys += [*begun.values(), *self._next(name, node.limit - len(begun))]
            self._in_tree = tuple(self._open_job(key.id) for key in sorted(keys))
        return self._in_tree

    def _next(self, name: str, count: int) -> Iterator[JobKey]:
        """The first `count` jobs of a type that are not begun."""
        for key in self._open[name]:
            if count <= 0:
                return
            if key.id not in self._begun[name]:
                count -= 1
                yield key

    def _open_job(self, name: str) -> OpenJob:
        job = self.known[name].job
        assert job is not None
        return OpenJob(name, job.type, job.arguments)

    # -- keeping the indices ------------------------------------------------------------------

    def add(self, entry: Entry) -> None:
        """Add a fact of a job, or of a guard that may be in a job's tree."""
        name = job_of(entry)
        if not name:
            return
        known = self._of(name)
        known.version += 1
        known.keys[entry.author, entry.name] = None
        match entry.record:
            case OperatorCommand():
                known.commands[entry.parts[0]] = entry
                if entry.parts[0] == records.JOB:
                    self.arrived[name] = None
            case Latch():
                known.due.add(entry.author)
            case JobEnd():
                known.ends[entry.author] = entry.record
                known.end_versions[entry.author] = entry.version
        if self.is_archived(name):
            self.obsolete |= known.keys
        elif known.is_settled:
            self.obsolete |= {key: None for key in known.keys if not _is_kept(key[1])}
        self._place(known)

    def remove(self, entry: Entry) -> None:
        """Remove a dropped fact of a job, or of a guard in its tree."""
        known = self.known[job_of(entry)]
        known.version += 1
        del known.keys[entry.author, entry.name]
        self.obsolete.pop((entry.author, entry.name), None)
        match entry.record:
            case OperatorCommand():
                del known.commands[entry.parts[0]]
            case Latch():
                known.due.discard(entry.author)
            case JobEnd():
                del known.ends[entry.author], known.end_versions[entry.author]
        self._place(known)

    def note_activation(self, name: str, activation: str, is_known: bool) -> None:
        """Note that facts of an activation of a job's tree now exist, or exist no more."""
        known = self._of(name)
        was_begun = known.is_begun
        if is_known:
            known.activations[activation] = None
        else:
            del known.activations[activation]
        if known.is_begun != was_begun:
            self._place(known)

    def note_result(self, name: str, result: Entry, is_known: bool) -> None:
        """Note that an outcome or failure in a job's tree now exists, or exists no more."""
        known = self._of(name)
        known.results.pop((result.author, result.name), None)
        if is_known:
            known.results[result.author, result.name] = result
        if known.ends:
            self._place(known)

    def note_claims(self, name: str, by: int) -> None:
        """Note that the number of robots that work on a job has changed by `by`."""
        known = self._of(name)
        was_begun = known.is_begun
        known.claims += by
        if known.is_begun != was_begun:
            self._place(known)

    def _of(self, name: str) -> KnownJob:
        known = self.known.get(name)
        if known is None:
            known = self.known[name] = KnownJob(name, self.witnesses)
        return known

    def _end_node(self, known: KnownJob) -> None:
        end = known.written_end
        kind = self._mission.jobs.get(end.type) if end is not None else None
        if end is None or kind is None or not kind.ends_mission:
            return
        if end.state in (JobState.SUCCEEDED, JobState.FAILED):
            origin = self._node_of[kind.name].index
            is_success = end.state is JobState.SUCCEEDED
            if is_success or origin not in self._ended_nodes:
                self._ended_nodes[origin] = Status.SUCCESS if is_success else Status.FAILURE

    def _place(self, known: KnownJob) -> None:
        """Recompute in which indices a job belongs."""
        before = self._placed.pop(known.id, None)
        if before is not None:
            name, key = before
            del self._open[name][bisect_left(self._open[name], key)]
            self._begun[name].pop(known.id, None)
            self._in_tree = None
        job = known.job
        if known.ends or known.id in self._ended:
            self._shares = None
        place = self._ended.pop(known.id, None)
        if place is not None:
            del self._by_end[bisect_left(self._by_end, place)]
        self._unended.pop(known.id, None)
        self._cancelled.pop(known.id, None)
        self._overruled.pop(known.id, None)
        self._unsettled.pop(known.id, None)
        if known.done_all_the_same:
            self._overruled[known.id] = None
        end = known.written_end
        if known.is_cancelled and job is not None and end is None:
            self._cancelled[known.id] = None
        if end is not None and not known.is_settled:
            self._unsettled[known.id] = None
        kind = self._mission.jobs.get(end.type) if end is not None else None
        if end is not None and not (kind is not None and kind.ends_mission):
            self._ended[known.id] = place = (end.stamp, known.id)
            insort(self._by_end, place)
        self._end_node(known)
        if not known.keys and not known.is_begun:
            del self.known[known.id]
        is_open = job is not None and not self.has_ended(known.id)
        if is_open:
            self._unended[known.id] = None
        # A job that is not due is not in the tree even if a robot works on it.
        waits = not known.is_due or (known.hold is not Hold.RELEASED and not known.is_begun)
        if job is None or not is_open or waits or not self.fits(job):
            return
        key = JobKey(-known.priority, known.arrival, known.id)
        insort(self._open[job.type], key)
        self._placed[known.id] = job.type, key
        if known.is_begun:
            self._begun[job.type][known.id] = key
        self._in_tree = None


def _is_kept(name: str) -> bool:
    """True if an entry of this name is kept after its job has ended."""
    return name.startswith(_KEPT)


def job_of(entry: Entry) -> str:
    """The job that a fact, or its guard or blackboard entry, belongs to; empty if it has none."""
    kind, name = entry.parts[:2]
    return name if kind in records.JOB_KINDS else job_in_guard(name)


def hash_of(name: str) -> int:
    """The hash that identifies a job in an archive, from 0 to `MAX_HASH`."""
    digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") & MAX_HASH


def job_in_guard(guard: str) -> str:
    """The job whose tree has this guard (`#7@morning-1:2`), or that owns this entry or comparison
    (`found@job:morning-1`); empty if the name is neither.
    """
    if guard.startswith("#"):
        return guard.partition("@")[2].partition(":")[0]
    return owning_job(guard)


def guard_number(guard: str) -> int:
    """The number of the node that a guard belongs to (`#7`, `#7@morning-1:2`); -1 if none."""
    number = guard.removeprefix("#").partition(":")[0].partition("@")[0]
    return int(number) if guard.startswith("#") and number.isdecimal() else -1
