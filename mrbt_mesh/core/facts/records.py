"""What entries mean: member, claim, outcome, condition, job; and their limits.

Values come from the network: a parser accepts exactly its kind and raises ValueError, and no other
exception, for anything else.
"""

from __future__ import annotations

import enum
from array import array
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeAlias, TypeVar, get_type_hints

from mrbt_mesh.core.facts.values import (
    read_boolean,
    read_data,
    read_fields,
    read_integer,
    read_reasons,
    read_text,
    shown,
    texts_by_reason,
)
from mrbt_mesh.core.feature import features
from mrbt_mesh.core.mission.conditions import MAX_TEXT, MAX_UNITS, Value
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MAX_PRIORITY, MAX_ROBOTS
from mrbt_mesh.core.mission.travel import MAX_HORIZON, MAX_MS, MAX_TIMED_PLACES

_Item = TypeVar("_Item")
# What was read of a condition (how often it has changed), or of another entry: (changes, stamp,
# author), since several values may come after as many changes.
Reading: TypeAlias = int | tuple[int, int, str]

MAX_NAME = 2_048
MAX_CAPABILITIES = 1_000
MAX_SUBJECT = 100
# The most jobs in one archive, and the largest hash.
MAX_ARCHIVED = 500
MAX_HASH = (1 << 53) - 1
# The largest count of overtakings of one task: higher counts make no difference.
MAX_OVERTAKEN = 1_000_000
# The subjects of problems with the robot itself. All others are parts of its program.
JOURNAL, CLOCK, NETWORK, PROCESS = "journal", "clock", "network", "process"
ADDRESS, RECORDING = "address", "recording"
OF_ROBOT = (JOURNAL, CLOCK, NETWORK, ADDRESS, PROCESS, RECORDING)
# Problems with a recording: it has ended (a reason follows), or was never asked for.
NOT_RECORDED, NOT_ASKED = "does not record", "does not record, as it was started so"


class Plain(NamedTuple):
    """How a field is plain data: `read` parses it or raises ValueError, `write` inverts that."""

    read: Callable[[Any], Any]
    write: Callable[[Any], Any] = lambda value: value


def _read_capabilities(value: Any) -> dict[str, int]:
    if not isinstance(value, dict) or len(value) > MAX_CAPABILITIES:
        raise ValueError("capabilities: a map expected")
    return {read_text(k): read_integer(v, 1, MAX_PERFORMANCE) for k, v in value.items()}


def _read_steps(value: Any) -> tuple[ProposedStep, ...]:
    if not isinstance(value, list) or len(value) > MAX_HORIZON:
        raise ValueError(f"a list of steps expected, found {shown(value)}")
    return tuple(map(ProposedStep.parse, value))


def _write_steps(steps: tuple[ProposedStep, ...]) -> list[Any]:
    return [step.to_value() for step in steps]


def _read_counts(value: Any) -> Mapping[str, int]:
    if not isinstance(value, dict) or len(value) > MAX_HORIZON:
        raise ValueError(f"a map of counts expected, found {shown(value)}")
    return {_read_name(k): read_integer(v, 1, MAX_OVERTAKEN) for k, v in value.items()}


def _read_robots(value: Any) -> tuple[tuple[str, ...], ...]:
    if not isinstance(value, list) or not all(isinstance(each, list) for each in value):
        raise ValueError(f"lists of robots expected, found {shown(value)}")
    if sum(map(len, value)) > MAX_ROBOTS:
        raise ValueError(f"at most {MAX_ROBOTS} robots expected")
    return tuple(tuple(map(read_text, each)) for each in value)


def _write_rows(rows: tuple[tuple[Any, ...], ...]) -> list[Any]:
    return [list(each) for each in rows]


def _read_list(value: Any, most: int, read: Callable[[Any], _Item]) -> tuple[_Item, ...]:
    if not isinstance(value, list) or len(value) > most:
        raise ValueError(f"a list of at most {most} expected, found {shown(value)}")
    return tuple(map(read, value))


_read_hash = partial(read_integer, low=0, high=MAX_HASH)
_read_texts = partial(_read_list, most=MAX_ROBOTS, read=read_text)
_read_places = partial(_read_list, most=MAX_TIMED_PLACES, read=read_text)


def _read_hashes(value: Any) -> Sequence[int]:
    return array("Q", _read_list(value, MAX_ARCHIVED, _read_hash))


def _read_ways(value: Any) -> tuple[tuple[int | None, ...], ...]:
    if not isinstance(value, list) or not all(isinstance(each, list) for each in value):
        raise ValueError(f"lists of travel times expected, found {shown(value)}")
    if any(len(each) != len(value) for each in value):
        raise ValueError("travel times from each place to each expected")
    return tuple(
        tuple(None if ms is None else read_integer(ms, high=MAX_MS) for ms in each)
        for each in value
    )


def _read_readings(value: Any) -> tuple[Reading, ...]:
    if not isinstance(value, list):
        raise ValueError(f"list of changes expected, found {shown(value)}")
    return tuple(map(_read_reading, value))


def _read_reading(value: Any) -> Reading:
    if not isinstance(value, list | tuple):
        return read_integer(value)
    changes, stamp, author = read_fields(list(value), 3)
    return read_integer(changes), read_integer(stamp), read_text(author)


def _read_value(value: Any) -> Value | None:
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        return read_text(value, MAX_TEXT)
    return read_integer(value, -MAX_UNITS, MAX_UNITS)


_PLAIN: Mapping[Any, Plain] = {
    str: Plain(read_text),
    int: Plain(read_integer),
    bool: Plain(read_boolean),
    Any: Plain(read_data),
}
_read_name = partial(read_text, limit=MAX_NAME)
_read_lost = partial(read_reasons, most=MAX_CAPABILITIES, longest=MAX_REASON)
_Name: TypeAlias = Annotated[str, Plain(_read_name)]
Reason: TypeAlias = Annotated[str, Plain(partial(read_text, limit=MAX_REASON))]
_Reasons: TypeAlias = Annotated[Mapping[str, str], Plain(_read_lost, texts_by_reason)]
_Positive: TypeAlias = Annotated[int, Plain(partial(read_integer, low=1))]
_Texts: TypeAlias = Annotated[tuple[str, ...], Plain(_read_texts, list)]
_priority = partial(read_integer, low=-MAX_PRIORITY, high=MAX_PRIORITY)
_Priority: TypeAlias = Annotated[int, Plain(_priority)]
_Robots: TypeAlias = Annotated[int, Plain(partial(read_integer, low=1, high=MAX_ROBOTS))]


class Record:
    """Base of all records: a frozen dataclass, represented on the wire as the list of its fields.

    A record with one field is that value alone. A field is read by its type, or by a `Plain` in its
    annotation. An author's newest entry wins, unless `write_once` or `rank` decide otherwise.
    """

    fields: ClassVar[Mapping[str, Plain]]
    write_once: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        hints = get_type_hints(cls, include_extras=True)
        cls.fields = {
            name: hints[name].__metadata__[0]
            if hasattr(hints[name], "__metadata__")
            else _PLAIN[hints[name]]
            for name in cls.__annotations__
            if name != "write_once"
        }

    def rank(self) -> int:
        return 0

    def to_value(self) -> Any:
        """The record as plain data."""
        values = [write(getattr(self, name)) for name, (_, write) in self.fields.items()]
        return values if len(values) > 1 else values[0]

    @classmethod
    def parse(cls, value: Any) -> Self:
        """Parse what `to_value` returns. Raises ValueError if the value is malformed."""
        make: Callable[..., Self] = cls
        values = read_fields(value, len(cls.fields)) if len(cls.fields) > 1 else [value]
        pairs = zip(cls.fields.values(), values, strict=True)
        return make(*[plain.read(each) for plain, each in pairs])


@dataclass(frozen=True, slots=True)
class Member(Record):
    """A robot's own description.

    `capabilities`: in micro-units. `lost`: capability -> why the robot has lost it (a minor fault).
    `pending`: capability -> what it waits for; the robot cannot use it yet, which is not a fault.
    `may_promise`: its journal can be written, as promises require. `watched`: those in
    `lost` whose end the robot notices itself, so that no operator can declare it; sorted.
    """

    type: str
    capabilities: Annotated[Mapping[str, int], Plain(_read_capabilities, dict)]
    lost: _Reasons
    is_leaving: bool
    software: str
    host: str
    pid: int
    may_promise: bool = True
    pending: _Reasons = field(default_factory=dict)
    watched: _Texts = ()

    def to_value(self) -> Any:
        """The record as plain data. `watched` is omitted if empty, as it usually is."""
        values = Record.to_value(self)
        return values if self.watched else values[:-1]

    @classmethod
    def parse(cls, value: Any) -> Self:
        """Parse what `to_value` returns. Raises ValueError if the value is malformed."""
        is_short = isinstance(value, list) and len(value) == len(cls.fields) - 1
        values = [*value, []] if is_short else value
        return super(Member, cls).parse(values)


class Phase(enum.IntEnum):
    """How far a claim has come. `TRAVELLING`: on its way to the place of its local task. `READY`:
    may start as soon as its party does.
    """

    CLAIMED = 1
    READY = 2
    RUNNING = 3
    TRAVELLING = 4


_Phase: TypeAlias = Annotated[Phase, Plain(lambda value: Phase(read_integer(value, 1, 4)), int)]


@dataclass(frozen=True, slots=True)
class Claim(Record):
    """The one activation that a robot works on. `since`: a Lamport stamp.

    `party`: the name of those with whom it runs its task jointly; empty if it does not. `place`:
    where the robot is, or where it has set out from; empty in a mission without places.
    """

    activation: _Name
    global_task: str
    local_task: str
    phase: _Phase
    since: int
    party: str = ""
    place: str = ""

    def to_value(self) -> list[Any]:
        value: list[Any] = Record.to_value(self)
        return value if self.place else value[:-1]


@dataclass(frozen=True, slots=True)
class NoClaim(Record):
    """The author works on nothing. `place`: as in `Claim`."""

    place: str = ""

    def to_value(self) -> str | None:
        return self.place or None


def parse_claim(value: Any) -> Claim | NoClaim:
    """Parse a claim; None or a place gives a NoClaim."""
    if value is None:
        return NO_CLAIM
    has_no_place = isinstance(value, list) and len(value) == len(Claim.fields) - 1
    found: Claim | NoClaim
    if isinstance(value, str):
        found = NoClaim.parse(value)
    else:
        found = Claim.parse([*value, ""] if has_no_place else value)
    if not has_no_place and not found.place:
        raise ValueError("an empty place is left out")
    return found


@dataclass(frozen=True, slots=True)
class ProposedStep(Record):
    """One task of a proposed schedule, and the robots for each of its needs."""

    activation: _Name
    robots: Annotated[tuple[tuple[str, ...], ...], Plain(_read_robots, _write_rows)]


@dataclass(frozen=True, slots=True)
class Proposal(Record):
    """A schedule that the author proposes: each robot does its tasks in this order."""

    steps: Annotated[tuple[ProposedStep, ...], Plain(_read_steps, _write_steps)]


@dataclass(frozen=True, slots=True)
class Overtaken(Record):
    """How often the author has begun a later task first, by activation that it overtook.

    Only activations that still lay ahead when this was written are counted. `begun`: what the
    author began last, or set out for. `has_turned`: it had set out for something else, and has not
    worked since. `left_ms`: how long it then still expected to be on its way to that.
    """

    begun: _Name
    has_turned: bool
    left_ms: int
    counts: Annotated[Mapping[str, int], Plain(_read_counts, dict)]


@dataclass(frozen=True, slots=True)
class TeamTime(Record):
    """The Unix time, by the author's clock, when it last had deadlines ahead."""

    unix_us: int


@dataclass(frozen=True, slots=True)
class TravelTimes(Record):
    """The author's travel times between all pairs of these places, as its program reports them;
    None: as the mission declares.
    """

    places: Annotated[tuple[str, ...], Plain(_read_places, list)]
    ways_ms: Annotated[tuple[tuple[int | None, ...], ...], Plain(_read_ways, _write_rows)]

    @classmethod
    def parse(cls, value: Any) -> TravelTimes:
        places, ways = read_fields(value, 2)
        found = cls(_read_places(places), _read_ways(ways))
        if len(set(found.places)) < len(found.ways_ms) or len(found.places) != len(found.ways_ms):
            raise ValueError("travel times between different places expected")
        return found


@dataclass(frozen=True, slots=True)
class Outcome(Record):
    """How the author ended one local task of one activation. Success wins. `reason`: of a failure,
    as given by the robot's program, else empty.
    """

    success: bool
    data: Any = None
    reason: str = ""

    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        return int(self.success)

    def to_value(self) -> list[Any]:
        return [self.success, self.data, self.reason] if self.reason else [self.success, self.data]

    @classmethod
    def parse(cls, value: Any) -> Outcome:
        has_reason = isinstance(value, list) and len(value) == 3
        success, data, *reason = read_fields(value, 3 if has_reason else 2)
        text = read_text(reason[0], MAX_REASON) if reason else ""
        if reason and (read_boolean(success) or not text):
            raise ValueError(f"the reason of a failure expected, found {shown(reason[0])}")
        return cls(read_boolean(success), read_data(data), text)


@dataclass(frozen=True, slots=True)
class ConditionValue(Record):
    """A condition, or another blackboard entry, as its author last saw or set it. None: no longer
    set. `changes` grows by one with each, so an author's value never reverts to an older one.
    """

    value: Annotated[Value | None, Plain(_read_value)]
    changes: _Positive
    stamp: int

    def rank(self) -> int:
        return self.changes


@dataclass(frozen=True, slots=True)
class ExpressionChanges(Record):
    """How often several conditions that decide together have changed their common value.

    `read`: how often these conditions had, sorted by name, when the last change was seen.
    """

    changes: _Positive
    read: Annotated[tuple[Reading, ...], Plain(_read_readings, list)]


@dataclass(frozen=True, slots=True)
class Arguments(Record):
    """The values with which an activation began, as arguments, of the entries that its task reads,
    sorted by name. If there are several records, the one with the smallest (stamp, author) counts.
    """

    values: _Texts
    stamp: int

    write_once: ClassVar[bool] = True


class TeamOrder(enum.StrEnum):
    """The operators' standing order to the team. `ABORT` is final."""

    RESUME = "resume"
    PAUSE = "pause"
    ABORT = "abort"


class Hold(enum.StrEnum):
    """Whether a job is held, so that no step of it begins. `NOW`: running steps are cancelled."""

    RELEASED = "released"
    HELD = "held"
    NOW = "now"


@dataclass(frozen=True, slots=True)
class Attempt(Record):
    """How many attempts of a Retry or Repeat are used up. Joins by maximum."""

    number: int

    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        return self.number


@dataclass(frozen=True, slots=True)
class ChildResult(Record):
    """How a child of a node with memory ended. Success wins."""

    success: bool

    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        return int(self.success)


@dataclass(frozen=True, slots=True)
class MissionResult(Record):
    """How the mission has ended, and how many of its robots agreed on that.

    Of one author's results, the one that more robots agreed on wins, then success.
    """

    success: bool
    agreed: _Robots

    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        return 2 * self.agreed + self.success


@dataclass(frozen=True, slots=True)
class RobotProblem(Record):
    """The newest problem with the author's journal, recording or clock, or with one part of its
    program: its bid, a function, the loop. Empty: the problem is solved.
    """

    text: Reason


def problem_text(subject: str, text: str) -> str:
    """A problem as a text for people."""
    return text if subject in OF_ROBOT else f"program problem, {subject}: {text}"


def as_subject(text: str) -> str:
    """Convert a problem's subject to the form allowed in a fact's name."""
    name = "".join(sign if sign.isprintable() and sign != "/" else "_" for sign in text)
    return name[:MAX_SUBJECT] or "_"


class JobState(enum.StrEnum):
    """How a job has ended."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"
    EXPIRED = "expired"


# How an archive encodes it.
JOB_ENDS: Mapping[str, JobState] = {state.value[0]: state for state in JobState}
_JobState: TypeAlias = Annotated[JobState, Plain(lambda value: JobState(read_text(value)), str)]


@dataclass(frozen=True, slots=True)
class Job(Record):
    """A job as it was submitted.

    It begins at `not_before_us` at the earliest and expires at `deadline_us`: Unix times in
    microseconds, 0: none. `content`: a hash of the request as the operator made it, where times may
    be relative, so that repeating a request gives the same job.
    """

    type: str
    arguments: _Texts
    priority: _Priority
    not_before_us: int
    deadline_us: int
    content: Annotated[int, Plain(_read_hash)] = 0


@dataclass(frozen=True, slots=True)
class JobEnd(Record):
    """How a job has ended. Success wins, then a cancellation. `robots`: those that worked on it.
    `content`: as in `Job`.
    """

    state: _JobState
    type: str
    arguments: _Texts
    operator: str
    reason: Reason
    robots: _Texts
    stamp: int
    content: Annotated[int, Plain(_read_hash)] = 0

    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        ranks = {JobState.SUCCEEDED: 2, JobState.CANCELLED: 1}
        return ranks.get(self.state, 0)


@dataclass(frozen=True, slots=True)
class JobArchive(Record):
    """Jobs that ended long ago, of which nothing else is kept. `hashes`: of their ids, sorted.

    In the same order: `contents`, their `Job.content`; `ends`, the first letters of how they ended,
    which is empty in archives of earlier versions.
    """

    hashes: Annotated[Sequence[int], Plain(_read_hashes, list)]
    contents: Annotated[Sequence[int], Plain(_read_hashes, list)]
    ends: str = ""

    write_once: ClassVar[bool] = True

    def to_value(self) -> list[Any]:
        value: list[Any] = Record.to_value(self)
        return value if self.ends else value[:-1]

    @classmethod
    def parse(cls, value: Any) -> JobArchive:
        ends = value[2:] if isinstance(value, list) else []
        hashes, contents = map(_read_hashes, read_fields(value, 2 + len(ends[:1]))[:2])
        found = cls(hashes, contents, *(read_text(each) for each in ends))
        if len(found.hashes) != len(found.contents) or [*found.hashes] != sorted({*found.hashes}):
            raise ValueError("different hashes in order, and a content for each, expected")
        if ends and (len(found.ends) != len(found.hashes) or set(found.ends) - set(JOB_ENDS)):
            raise ValueError("an end of each job expected")
        return found

    def end_of(self, hashed: int) -> JobState | None:
        """How the job with this hash ended. None if it is not in here, or its end is not kept."""
        place = bisect_left(self.hashes, hashed)
        is_here = place < len(self.hashes) and self.hashes[place] == hashed
        return JOB_ENDS[self.ends[place]] if is_here and self.ends else None


@dataclass(frozen=True, slots=True)
class OperatorCommand(Record):
    """What an operator commands: the value of one field of one subject, as named by the entry.

    Its author is `OPERATORS`, and its version the stamp and the id given by the operator's client,
    so it is the same entry whichever robot takes it, and whenever. `signer`: in a team with keys,
    the member that signed it. `signature`: in hex.
    """

    value: Any
    operator: str
    signer: str = ""
    signature: str = ""

    def to_value(self) -> list[Any]:
        value = self.value
        if isinstance(value, Record):
            value = value.to_value()
        elif isinstance(value, enum.StrEnum):
            value = str(value)
        return [value, self.operator, self.signer, self.signature]

    @classmethod
    def read(cls, field: Callable[[Any], Any], value: Any) -> Self:
        """Parse a command whose value is read by `field`. Raises ValueError if it is malformed."""
        given, operator, signer, signature = read_fields(value, 4)
        texts = [_read_name_of_operator(operator), read_text(signer), read_text(signature)]
        return cls(field(given), *texts)


@dataclass(frozen=True, slots=True)
class FirstCommand(OperatorCommand):
    """A command of a field that is commanded only once: the first one counts."""

    write_once: ClassVar[bool] = True


def stamp_of(record: Record) -> int:
    """The Lamport stamp of a record; 0 if it has none."""
    return record.since if isinstance(record, Claim) else getattr(record, "stamp", 0)


def command_text(parts: Sequence[str], command: OperatorCommand) -> str:
    """A command as a text. `parts`: the parts of its name."""
    field, *subject = parts
    value = command.value
    if isinstance(value, Record):
        value = ""
    return " ".join([field, *subject, str(value)]).rstrip()


def _read_name_of_operator(value: Any) -> str:
    text = read_text(value)
    if not text.isprintable():
        raise ValueError(f"one line of printable text expected, found {shown(text)}")
    return text


def read_true(value: Any) -> bool:
    if value is not True:
        raise ValueError(f"true expected, found {shown(value)}")
    return True


def _read_team_order(value: Any) -> TeamOrder:
    order = TeamOrder(read_text(value))
    if order is TeamOrder.ABORT:
        raise ValueError("an abort is a field of its own")
    return order


@dataclass(frozen=True, slots=True)
class Latch(Record):
    """Something that stays true once written, such as a latched failure."""

    write_once: ClassVar[bool] = True

    def to_value(self) -> bool:
        return True

    @classmethod
    def parse(cls, value: Any) -> Latch:
        if value is not True:
            raise ValueError("a latch can only be true")
        return LATCH


LATCH, NO_CLAIM, NO_TRAVEL_TIMES = Latch(), NoClaim(), TravelTimes((), ())

# The author of what operators command; not a robot id.
OPERATORS = "@operators"
# Fields of commands; features have more. For the team: PAUSED, ABORTED. By job id: JOB (submitted),
# JOB_HOLD, JOB_PRIORITY, JOB_CANCELLED.
PAUSED, ABORTED = "paused", "aborted"
JOB, JOB_HOLD, JOB_PRIORITY, JOB_CANCELLED = "job", "job_hold", "job_priority", "job_cancelled"
MEMBER, CLAIM, RESULT = "member", "claim", "result"
OUTCOME, CONDITION, ATTEMPT = "outcome", "condition", "attempt"
# LATCHED_FAILURE: an activation has failed for good. EXPIRED: the time of a Timeout is over.
LATCHED_FAILURE, EXPIRED = "latched_failure", "expired"
# An expression of conditions that is a guard.
EXPRESSION = "expression"
# The blackboard values with which an activation began.
ARGUMENTS = "arguments"
# A child of a node with memory has ended: scope of the node, position of the child.
CHILD_RESULT = "passed"
# A problem with a part of the author's program.
PROBLEM = "problem"
# How a job has ended.
JOB_END = "job_end"
# The time has come before which a job must not begin.
JOB_DUE = "job_due"
# Jobs that ended earlier than those whose ends are kept.
JOB_ARCHIVE = "job_archive"
JOB_KINDS = frozenset({JOB, JOB_HOLD, JOB_PRIORITY, JOB_CANCELLED, JOB_DUE, JOB_END})
# Facts of activations in a job's tree that support the job's end.
RESULTS_IN_JOBS = frozenset({OUTCOME, LATCHED_FAILURE, EXPIRED})
# The author's proposed schedule, and its travel times; what it has begun out of turn, and its last
# reported time.
SCHEDULE, TRAVEL_TIMES = "schedule", "travel_times"
OVERTAKEN, TEAM_TIME = "overtaken", "team_time"
# Kinds of features that have a place, and count, whichever mission of the team is in force.
IN_ANY_MISSION = frozenset(kind for feature in features() for kind in feature.in_any_mission)


def _command_type(is_once: bool) -> type[OperatorCommand]:
    return FirstCommand if is_once else OperatorCommand


# Fields of commands -> how a value is read, and how many parts a name has. `_ONCE`: commanded once,
# the first command counts. `_AGAIN`: the newest command counts.
_ONCE: Mapping[str, tuple[Callable[[Any], Any], int]] = {
    JOB: (Job.parse, 2),
}
_AGAIN: Mapping[str, tuple[Callable[[Any], Any], int]] = {
    PAUSED: (_read_team_order, 1),
    ABORTED: (read_true, 1),
    JOB_HOLD: (Hold, 2),
    JOB_PRIORITY: (_priority, 2),
    JOB_CANCELLED: (read_true, 2),
}
# Kind -> its parser, and the numbers of parts that a name may have: kind / condition, scope or
# activation / local task or position / party
_KINDS: Mapping[str, tuple[Callable[[Any], Record], tuple[int, ...]]] = {
    MEMBER: (Member.parse, (1,)),
    CLAIM: (parse_claim, (1,)),
    RESULT: (MissionResult.parse, (1,)),
    OUTCOME: (Outcome.parse, (3, 4)),
    CONDITION: (ConditionValue.parse, (2,)),
    EXPRESSION: (ExpressionChanges.parse, (2,)),
    ATTEMPT: (Attempt.parse, (2,)),
    ARGUMENTS: (Arguments.parse, (2,)),
    CHILD_RESULT: (ChildResult.parse, (3,)),
    PROBLEM: (RobotProblem.parse, (2,)),
    SCHEDULE: (Proposal.parse, (1,)),
    JOB_END: (JobEnd.parse, (2,)),
    JOB_ARCHIVE: (JobArchive.parse, (2,)),
    TRAVEL_TIMES: (TravelTimes.parse, (1,)),
    OVERTAKEN: (Overtaken.parse, (1,)),
    TEAM_TIME: (TeamTime.parse, (1,)),
    **{
        field: (partial(FirstCommand.read, read), (count,))
        for field, (read, count) in _ONCE.items()
    },
    **{
        field: (partial(OperatorCommand.read, read), (count,))
        for field, (read, count) in _AGAIN.items()
    },
    **dict.fromkeys((LATCHED_FAILURE, EXPIRED, JOB_DUE), (Latch.parse, (2,))),
    **{
        field: (partial(_command_type(known.once).read, known.read), (known.parts,))
        for feature in features()
        for field, known in feature.commands.items()
    },
    **{
        kind: (partial(feature.parse, kind), (count,))
        for feature in features()
        for kind, count in (*feature.kinds.items(), *feature.team_kinds.items())
    },
}
COMMANDS = frozenset({*_ONCE, *_AGAIN, *(f for each in features() for f in each.commands)})


# Cached: each name is read several times, by every robot simulated in one process.
@lru_cache(maxsize=4_096)
def split_name(name: str) -> tuple[str, ...]:
    """Split an entry's name into its parts, kind first. Raises ValueError if it is malformed."""
    parts = tuple(name.split("/"))
    if parts[0] not in _KINDS or len(parts) not in _KINDS[parts[0]][1]:
        raise ValueError(f"no kind of fact has the name {shown(name)}")
    return parts


def parse_record(name: str, value: Any) -> tuple[tuple[str, ...], Record]:
    """Return the parts of an entry's name, and its record. Raises ValueError if malformed."""
    if _read_name(name) != name:
        raise ValueError(f"a printable name expected, found {shown(name)}")
    parts = split_name(name)
    return parts, _KINDS[parts[0]][0](value)
