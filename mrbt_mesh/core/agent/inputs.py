"""The inputs of an agent: plain data without behaviour."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

from mrbt_mesh.core.facts.description import PROGRAM
from mrbt_mesh.core.facts.records import TravelTimes
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.membership.envelope import Envelope
from mrbt_mesh.core.membership.wire import MessageKind, Position, RecordingHead
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.scheduling.problem import Schedule


@dataclass(frozen=True, slots=True)
class MessageReceived:
    """A heartbeat or a batch of facts, published under the key of `source`.

    `envelope`: the envelope of `data`, if its tag has already been checked. `arrived_us`: when it
    arrived, if it had to wait; not before the last input that was handled.
    """

    kind: MessageKind
    source: str
    data: bytes
    envelope: Envelope | None = field(default=None, compare=False, repr=False)
    arrived_us: int | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class TokenChanged:
    """A robot's liveliness token appeared (`held`) or disappeared.

    `router`: the router that the robot is a client of; empty where robots have links of their own.
    """

    robot: str
    incarnation: Incarnation
    held: bool
    router: str = ""


@dataclass(frozen=True, slots=True)
class RouterAnswered:
    """The answer to AskRouter: whether a router has a link to the robot.

    None: no router is known to have one, and the one that was asked does not answer.
    """

    robot: str
    incarnation: Incarnation
    is_linked: bool | None


@dataclass(frozen=True, slots=True)
class QueryReceived:
    """A query (PULL or COMMAND). Answer it with `Reply(query, ...)`."""

    query: int
    kind: MessageKind
    data: bytes


@dataclass(frozen=True, slots=True)
class AnswerReceived:
    """A peer's answer to `Ask`, or None if it did not answer in time."""

    peer: str
    data: bytes | None


@dataclass(frozen=True, slots=True)
class InputRefused:
    """The runtime has refused `count` inputs."""

    source: str
    reason: str
    count: int


@dataclass(frozen=True, slots=True)
class ActionFinished:
    """The action under `ticket` ended by itself.

    `conditions`: the conditions and other entries that it set, which are written together with the
    outcome. `error`: for the log. `reason`: why it failed, for the team, empty if unknown.
    """

    ticket: int
    success: bool
    conditions: tuple[tuple[str, Value | None], ...] = ()
    error: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class ActionStopped:
    """The action under `ticket` has been cancelled, and nothing of it runs any more."""

    ticket: int


@dataclass(frozen=True, slots=True)
class ProgressReported:
    """The progress of the action, in percent."""

    ticket: int
    percent: int


@dataclass(frozen=True, slots=True)
class TreeTicked:
    """The tree that carries out the action has been ticked. `statuses`: of its nodes in preorder,
    one byte each.
    """

    ticket: int
    statuses: bytes


@dataclass(frozen=True, slots=True)
class PositionReported:
    """Where the robot is. Its next heartbeats carry this."""

    position: Position


@dataclass(frozen=True, slots=True)
class RecordingSigned:
    """How far the robot's recording is signed. Its next heartbeats carry this."""

    head: RecordingHead


@dataclass(frozen=True, slots=True)
class ConditionSet:
    """The robot's own code has set a condition or another entry, outside of any outcome.

    `job`: the job whose task set it, empty if none. `value` None: the entry is no longer set.
    """

    name: str
    value: Value | None
    job: str = ""


@dataclass(frozen=True, slots=True)
class CapabilityChanged:
    """A minor fault (`lost`) or its end. `local_task`: a type, a ground name, or `all`.

    `reason`: one line of text. `source`: its origin (`Description`). `is_pending`: not a fault, but
    the capability cannot be used yet. `is_watched`: the source notices its end, so no operator can
    declare it.
    """

    local_task: str
    lost: bool
    reason: str = ""
    source: str = PROGRAM
    is_pending: bool = False
    is_watched: bool = False


@dataclass(frozen=True, slots=True)
class PerformanceChanged:
    """The performance of a local task from now on, in micro-units; 0: a minor fault.

    `local_task`: a type or a ground name.
    """

    local_task: str
    performance: int


@dataclass(frozen=True, slots=True)
class ProblemFound:
    """A problem of the robot's own program. `subject` names the part, `text` describes it.

    It is shown to people and has no other effect.
    """

    subject: str
    text: str


@dataclass(frozen=True, slots=True)
class FeatureInput:
    """Base of the inputs of features: the feature's part of the agent takes them."""


@dataclass(frozen=True, slots=True)
class TravelTimesMade:
    """This robot's travel times from its program; empty if it has no function for them or fails."""

    times: TravelTimes


@dataclass(frozen=True, slots=True)
class WallClockRead:
    """The robot's wall clock minus the clock of the inputs' times is `offset_us`.

    The first input, repeated when the offset has changed; only missions with jobs need it.
    """

    offset_us: int


@dataclass(frozen=True, slots=True)
class LeaveRequested:
    """Leave on purpose: hand the work over and stop."""


@dataclass(frozen=True, slots=True)
class TimerFired:
    """`next_deadline_us` has come."""


@dataclass(frozen=True, slots=True)
class PlanMade:
    """The plan requested by MakePlan with this number."""

    number: int
    plan: Plan


@dataclass(frozen=True, slots=True)
class ScheduleFound:
    """The schedule requested by SearchSchedule with this number."""

    number: int
    schedule: Schedule


@dataclass(frozen=True, slots=True)
class JournalSynced:
    """The entries of Persist with this number, and all earlier ones, are on disk."""

    number: int


@dataclass(frozen=True, slots=True)
class JournalReported:
    """The journal's problem as a text, empty if it has none. `is_failing`: it cannot be written.

    The runtime retries the entries that it could not write.
    """

    problem: str
    is_failing: bool = False


@dataclass(frozen=True, slots=True)
class RecordingReported:
    """Why the robot does not record what it does, as a text; empty if it does."""

    problem: str


@dataclass(frozen=True, slots=True)
class JournalOpened:
    """The journal was opened while the robot runs, and holds only these entries.

    It could not be opened before, or was deleted or damaged.
    """

    entries: tuple[Entry, ...]


NetworkInput: TypeAlias = (
    MessageReceived | TokenChanged | RouterAnswered | AnswerReceived | InputRefused
)

FromOutside: TypeAlias = NetworkInput | QueryReceived


@dataclass(frozen=True, slots=True)
class InputBatch:
    """Inputs that waited together, oldest first. All are processed before the agent acts."""

    inputs: tuple[NetworkInput, ...]


Input: TypeAlias = (
    FromOutside
    | InputBatch
    | ActionFinished
    | ActionStopped
    | ProgressReported
    | TreeTicked
    | PositionReported
    | RecordingSigned
    | ConditionSet
    | CapabilityChanged
    | PerformanceChanged
    | FeatureInput
    | TravelTimesMade
    | ProblemFound
    | WallClockRead
    | LeaveRequested
    | TimerFired
    | PlanMade
    | ScheduleFound
    | JournalSynced
    | JournalReported
    | RecordingReported
    | JournalOpened
)


# The most inputs of one batch: a few milliseconds of work.
AT_ONCE = 25


def together(waiting: Iterable[Input]) -> Iterator[Input]:
    """Yield the inputs that waited, in order; consecutive network inputs are batched.

    So a robot that was slow hears all the others before it judges their silence, and acts once.
    Inputs of the robot itself or of an operator are not batched: each is a step of the tree.
    """
    batch: list[NetworkInput] = []
    for event in waiting:
        if isinstance(event, NetworkInput):
            batch.append(event)
            if len(batch) < AT_ONCE:
                continue
        if len(batch) == 1:
            yield batch[0]
        elif batch:
            yield InputBatch(tuple(batch))
        batch.clear()
        if not isinstance(event, NetworkInput):
            yield event
    if batch:
        yield InputBatch(tuple(batch)) if len(batch) > 1 else batch[0]
