"""What a history of a team's jobs must satisfy, whoever made it.

A history has what clients asked and were answered, with times, and what robots did, by files that
the robots' own program wrote. The rules follow docs/how-to/jobs.md and
docs/explanation/guarantees.md, and share no code with the product. All times are seconds of one
clock that all processes of the machine read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

# How long after an acknowledgement a robot that is in contact may still begin by older news.
NEWS_S = 1.0
# An answer that comes later than this is none.
ANSWER_S = 20.0
# Of a job that ended long ago only its id is kept, and not how it has ended.
LONG_AGO = "ended long ago"
ENDED = ("succeeded", "failed", "cancelled", "expired", LONG_AGO)
SUBMIT, HOLD, RELEASE, CANCEL, PRIORITY = "submit", "hold", "release", "cancel", "priority"
DONE, REFUSED, UNKNOWN = "done", "refused", "unknown"


@dataclass(frozen=True, slots=True)
class Operation:
    """What one client asked. `value`: the content of a submission or the new priority.

    `answer`: it is in force (DONE), it is not (REFUSED), or the client cannot know (UNKNOWN: an
    error of the connection, or too few robots answered). `answered_s` is None without an answer.
    """

    client: str
    kind: str
    job: str
    value: int
    invoked_s: float
    answered_s: float | None
    answer: str
    text: str = ""


@dataclass(frozen=True, slots=True)
class Read:
    """What a server showed of a job. `state` is empty for a job that it does not know."""

    client: str
    job: str
    state: str
    priority: int | None
    invoked_s: float
    answered_s: float


@dataclass(frozen=True, slots=True)
class Work:
    """One robot's work on the job with this content: from its first step to its last.

    `end`: success, cancelled, or empty if the process was killed at work.
    """

    robot: str
    content: int
    begun_s: float
    last_s: float
    end: str


@dataclass(frozen=True, slots=True)
class Fault:
    """Something done to a robot: kill, freeze, cut (off from the others)."""

    kind: str
    robot: str
    begun_s: float
    ended_s: float


@dataclass(slots=True)
class History:
    """`exclusive`: the contents of jobs that must not be done twice. `parked`: jobs that are not
    due before the end. `quiet`: job -> what each server shows of a parked one when nobody has
    changed it for minutes, before it is cancelled. `final`: job -> what each shows at the end.
    """

    operations: list[Operation] = field(default_factory=list)
    reads: list[Read] = field(default_factory=list)
    works: list[Work] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    exclusive: set[int] = field(default_factory=set)
    parked: set[str] = field(default_factory=set)
    quiet: dict[str, list[Read]] = field(default_factory=dict)
    final: dict[str, list[Read]] = field(default_factory=dict)


RULES = (
    "answered",
    "one content",
    "lost",
    "twice",
    "not asked for",
    "cancelled",
    "held",
    "in force",
)


def violations(history: History) -> dict[str, list[str]]:
    """Rule -> a sentence for each time that it is broken; every rule is a key."""
    by_job: dict[str, list[Operation]] = defaultdict(list)
    for operation in history.operations:
        by_job[operation.job].append(operation)
    works: dict[int, list[Work]] = defaultdict(list)
    for work in sorted(history.works, key=lambda each: (each.begun_s, each.robot)):
        works[work.content].append(work)
    broken: dict[str, list[str]] = {rule: [] for rule in RULES}
    for operation in history.operations:
        broken["answered"] += _answered(operation)
    for job, operations in by_job.items():
        final = history.final.get(job, [])
        submitted = [each for each in operations if each.kind == SUBMIT]
        done = {each.value for each in submitted if each.answer == DONE}
        if len(done) > 1:
            broken["one content"].append(f"{job} was acknowledged with contents {sorted(done)}")
        at_work = [work for each in submitted for work in works.get(each.value, [])]
        # It may have failed since nobody knows whether a robot that was disturbed had begun it.
        first_s = min((each.invoked_s for each in submitted), default=0.0)
        is_in_doubt = any(
            each.value in history.exclusive for each in submitted if each.answer != REFUSED
        ) and any(fault.ended_s >= first_s for fault in history.faults)
        is_parked = job in history.parked
        broken["lost"] += _lost(job, operations, at_work, final, is_parked, is_in_doubt)
        broken["cancelled"] += _cancelled(job, operations, at_work, history.faults, final)
        broken["held"] += _held(job, operations, at_work, history.faults)
        broken["in force"] += _in_force(job, operations, history.quiet.get(job, final))
    for content in sorted(history.exclusive):
        broken["twice"] += _twice(content, works.get(content, []))
    broken["not asked for"] += _not_asked_for(history.operations, works)
    return broken


def _answered(operation: Operation) -> Iterator[str]:
    took_s = None if operation.answered_s is None else operation.answered_s - operation.invoked_s
    if took_s is None or took_s > ANSWER_S:
        when = "no answer" if took_s is None else f"answered after {took_s:.1f} s"
        yield f"{operation.client}: {operation.kind} {operation.job}: {when}"
    elif operation.text.startswith("!"):
        yield f"{operation.client}: {operation.kind} {operation.job}: {operation.text[1:]}"


def _lost(
    job: str,
    operations: Sequence[Operation],
    works: Sequence[Work],
    final: Sequence[Read],
    is_parked: bool,
    may_be_in_doubt: bool,
) -> Iterator[str]:
    """A job that was acknowledged has ended, or is held by somebody, and every server knows it."""
    if not any(each.kind == SUBMIT and each.answer == DONE for each in operations):
        return
    if not final or not all(each.state for each in final):
        yield f"{job} was acknowledged, and is unknown at the end"
        return
    asked = {each.kind for each in operations if each.answer != REFUSED}
    states = {each.state for each in final}
    if LONG_AGO in states and CANCEL not in asked and not works and not may_be_in_doubt:
        yield f"{job} was acknowledged, has ended, and no robot has begun it"
    states = states - {LONG_AGO} or states
    if len(states) > 1:
        yield f"{job}: servers show different states at the end: {sorted(states)}"
        return
    state = min(states)
    if state == "succeeded" and not any(work.end == "success" for work in works):
        yield f"{job} has succeeded, and no robot has done it"
    if state == "cancelled" and CANCEL not in asked:
        yield f"{job} is cancelled, and nobody asked for that"
    may_be_open = is_parked or (state == "held" and HOLD in asked)
    if state not in ENDED and not may_be_open:
        yield f"{job} was acknowledged, and is {state} at the end"


def _twice(content: int, works: Sequence[Work]) -> Iterator[str]:
    """Exclusive work that has begun is left in doubt if it does not end, and never begun again."""
    for earlier, later in pairwise(works):
        yield (
            f"exclusive {content}: {later.robot} begins at {later.begun_s:.3f}, after "
            f"{earlier.robot} at {earlier.begun_s:.3f} ({earlier.end or 'killed'})"
        )


def _not_asked_for(
    operations: Iterable[Operation], works: Mapping[int, Sequence[Work]]
) -> Iterator[str]:
    """Nothing is done that nobody submitted, or whose only submissions were refused."""
    asked: dict[int, list[Operation]] = defaultdict(list)
    for operation in operations:
        if operation.kind == SUBMIT:
            asked[operation.value].append(operation)
    for content, found in works.items():
        if not asked[content]:
            yield f"{found[0].robot} did {content}, which nobody submitted"
        elif all(each.answer == REFUSED for each in asked[content]):
            yield f"{found[0].robot} did {content}, which was refused: {asked[content][0].text}"


def _was_out(robot: str, faults: Iterable[Fault], from_s: float, to_s: float) -> bool:
    """Whether the robot may have missed news at some time between these two."""
    return any(
        fault.robot == robot and fault.begun_s <= to_s and fault.ended_s + NEWS_S >= from_s
        for fault in faults
        if fault.kind in ("cut", "freeze")
    )


def _cancelled(
    job: str,
    operations: Sequence[Operation],
    works: Sequence[Work],
    faults: Sequence[Fault],
    final: Sequence[Read],
) -> Iterator[str]:
    """After an acknowledged cancellation no robot begins that could have heard of it."""
    times = [
        each.answered_s
        for each in operations
        if each.kind == CANCEL and each.answer == DONE and each.answered_s is not None
    ]
    if not times:
        return
    for work in works:
        from_s = min(times)
        if work.begun_s > from_s + NEWS_S and not _was_out(
            work.robot, faults, from_s, work.begun_s
        ):
            late_s = work.begun_s - from_s
            yield f"{work.robot} begins {job} {late_s:.1f} s after it was cancelled"
    if any(each.state and each.state not in ENDED for each in final):
        yield f"{job} was cancelled, and is {final[0].state} at the end"


def _held(
    job: str, operations: Sequence[Operation], works: Sequence[Work], faults: Sequence[Fault]
) -> Iterator[str]:
    """Between an acknowledged hold and the next release no robot in contact begins it."""
    for hold in operations:
        if hold.kind != HOLD or hold.answer != DONE or hold.answered_s is None:
            continue
        # A release that may have come after the hold, by the order in which robots took them.
        later = [
            each.invoked_s
            for each in operations
            if each.kind == RELEASE
            and each.answer != REFUSED
            and (each.answered_s is None or each.answered_s > hold.invoked_s)
        ]
        until_s = min(later, default=float("inf"))
        for work in works:
            if hold.answered_s + NEWS_S < work.begun_s < until_s and not _was_out(
                work.robot, faults, hold.invoked_s, work.begun_s
            ):
                yield f"{work.robot} begins {job} at {work.begun_s:.3f}, which is held"


def may_be_last(operations: Sequence[Operation]) -> list[Operation]:
    """Which of these writes of one field may be the one in force, once all is quiet.

    A write is overwritten for certain by one that was acknowledged and began after its answer.
    """
    return [
        each
        for each in operations
        if each.answer != REFUSED
        and not any(
            other.answer == DONE
            and each.answered_s is not None
            and each.answer == DONE
            and other.invoked_s > each.answered_s
            for other in operations
        )
    ]


def _in_force(job: str, operations: Sequence[Operation], final: Sequence[Read]) -> Iterator[str]:
    """What is shown when all is quiet is what somebody wrote last, whatever other fields are."""
    shown = [each for each in final if each.state and each.state not in ENDED]
    priorities = [each for each in operations if each.kind == PRIORITY]
    if any(each.answer == DONE for each in priorities):
        allowed = {each.value for each in may_be_last(priorities)}
        for read in shown:
            if read.priority not in allowed:
                yield f"{job} has priority {read.priority}, and {sorted(allowed)} was written last"
    holds = [each for each in operations if each.kind in (HOLD, RELEASE)]
    if any(each.answer == DONE for each in holds):
        kinds = {each.kind for each in may_be_last(holds)}
        for read in shown:
            if kinds == {HOLD} and read.state != "held":
                yield f"{job} was held last, and is {read.state}"
            if kinds == {RELEASE} and read.state == "held":
                yield f"{job} was released last, and is held"
