"""What an entry means: member, claim, outcome, bid, coalition, condition, order; their limits.

Values come from the network: every parser raises ValueError for anything that is not exactly
its kind, and nothing else.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

from mrbt_mesh.core.facts.problems import RobotProblem
from mrbt_mesh.core.facts.values import (
    Record,
    check_depth,
    read_boolean,
    read_fields,
    read_integer,
    read_reasons,
    read_text,
    shown,
    texts_by_reason,
)
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MAX_ROBOTS

MAX_NAME = 2_048
MAX_CAPABILITIES = 1_000


@dataclass(frozen=True, slots=True)
class Member(Record):
    """A robot's own description.

    `lost`: capability -> why the robot has lost it (a minor fault). `pending`: capability -> what
    it waits for; the robot cannot use it yet, which is no fault.
    `may_promise`: its journal can be written, as exclusive tasks need it.
    """

    type: str
    capabilities: Mapping[str, int]
    lost: Mapping[str, str]
    is_leaving: bool
    software: str
    host: str
    pid: int
    may_promise: bool = True
    pending: Mapping[str, str] = field(default_factory=dict)

    def to_value(self) -> list[Any]:
        """As on the wire."""
        about = [self.is_leaving, self.software, self.host, self.pid, self.may_promise]
        lost, pending = texts_by_reason(self.lost), texts_by_reason(self.pending)
        return [self.type, dict(self.capabilities), lost, *about, pending]

    @staticmethod
    def parse(value: Any) -> Member:
        kind, capabilities, lost, leaving, software, host, pid, *more = read_fields(value, 9)
        may_promise, pending = more
        if not isinstance(capabilities, dict) or len(capabilities) > MAX_CAPABILITIES:
            raise ValueError("capabilities: a map expected")
        table = {read_text(k): read_integer(v, 1, MAX_PERFORMANCE) for k, v in capabilities.items()}
        return Member(
            read_text(kind),
            table,
            read_reasons(lost, MAX_CAPABILITIES, MAX_REASON),
            read_boolean(leaving),
            read_text(software),
            read_text(host),
            read_integer(pid),
            read_boolean(may_promise),
            read_reasons(pending, MAX_CAPABILITIES, MAX_REASON),
        )


class Phase(enum.IntEnum):
    """How far a claim is. `READY`: may start as soon as its coalition does."""

    CLAIMED = 1
    READY = 2
    RUNNING = 3


@dataclass(frozen=True, slots=True)
class Claim(Record):
    """The one activation that a robot works on; `since` is a Lamport stamp.

    `coalition` is the token of the coalition with which it runs, if its task has any.
    """

    activation: str
    global_task: str
    local_task: str
    phase: Phase
    since: int
    coalition: str = ""

    def to_value(self) -> list[Any]:
        phase = int(self.phase)
        task = [self.activation, self.global_task, self.local_task]
        return [*task, phase, self.since, self.coalition]


@dataclass(frozen=True, slots=True)
class NoClaim(Record):
    """The author works on nothing."""


def parse_claim(value: Any) -> Claim | NoClaim:
    """A claim, or NoClaim for None."""
    if value is None:
        return NoClaim()
    activation, global_task, local_task, phase, since, coalition = read_fields(value, 6)
    return Claim(
        read_text(activation, MAX_NAME),
        read_text(global_task),
        read_text(local_task),
        Phase(read_integer(phase, 1, 3)),
        read_integer(since),
        read_text(coalition),
    )


@dataclass(frozen=True, slots=True, order=True)
class CoalitionId:
    """Names one coalition: its leader, in the life and with the claim that brought it together.

    `since` is the stamp of the leader's claim. The order is the canonical one of claims.
    """

    since: int
    leader: str
    counter: int
    nonce: str

    def __str__(self) -> str:
        return f"{self.leader}.{self.counter}.{self.nonce}.{self.since}"

    @staticmethod
    def parse(text: str) -> CoalitionId:
        leader, counter, nonce, since = read_text(text).split(".")
        token = CoalitionId(read_integer(int(since)), leader, read_integer(int(counter)), nonce)
        if str(token) != text:
            raise ValueError(f"no coalition has the name {shown(text)}")
        return token


@dataclass(frozen=True, slots=True)
class CoalitionMember:
    """A robot that starts with a coalition, and the claim with which it was ready.

    (`counter`, `nonce`, `sequence`) is the version of the claim's entry.
    """

    robot: str
    local_task: str
    counter: int
    nonce: str
    sequence: int
    since: int


@dataclass(frozen=True, slots=True)
class Coalition(Record):
    """The robots that start one activation together, as their leader wrote them down."""

    members: tuple[CoalitionMember, ...]
    write_once: ClassVar[bool] = True

    def to_value(self) -> list[Any]:
        return [
            [m.robot, m.local_task, m.counter, m.nonce, m.sequence, m.since] for m in self.members
        ]

    @staticmethod
    def parse(value: Any) -> Coalition:
        if not isinstance(value, list) or not 0 < len(value) <= MAX_ROBOTS:
            raise ValueError(f"a list of members expected, found {shown(value)}")
        rows = [read_fields(row, 6) for row in value]
        return Coalition(
            tuple(
                CoalitionMember(
                    read_text(robot),
                    read_text(local_task),
                    read_integer(counter),
                    read_text(nonce),
                    read_integer(sequence),
                    read_integer(since),
                )
                for robot, local_task, counter, nonce, sequence, since in rows
            )
        )


@dataclass(frozen=True, slots=True)
class Outcome(Record):
    """How the author ended one local task of one activation; success wins. `reason`: of a failure,
    as the robot's program says it, else empty.
    """

    success: bool
    data: Any
    reason: str = ""
    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        return int(self.success)

    def to_value(self) -> list[Any]:
        return [self.success, self.data, self.reason] if self.reason else [self.success, self.data]

    @staticmethod
    def parse(value: Any) -> Outcome:
        has_reason = isinstance(value, list) and len(value) == 3
        success, data, *reason = read_fields(value, 3 if has_reason else 2)
        check_depth(data)
        if reason and (read_boolean(success) or not read_text(reason[0], MAX_REASON)):
            raise ValueError(f"the reason of a failure expected, found {shown(reason[0])}")
        return Outcome(read_boolean(success), data, *reason)


@dataclass(frozen=True, slots=True)
class ConditionValue(Record):
    """A condition as its author last saw or set it; `revision` grows by one at each change."""

    value: bool
    revision: int
    stamp: int

    def to_value(self) -> list[Any]:
        return [self.value, self.revision, self.stamp]

    @staticmethod
    def parse(value: Any) -> ConditionValue:
        holds, revision, stamp = read_fields(value, 3)
        return ConditionValue(read_boolean(holds), read_integer(revision, 1), read_integer(stamp))


@dataclass(frozen=True, slots=True)
class ExpressionRevision(Record):
    """How often several conditions that decide together have changed what they say.

    `read`: the revisions of these conditions, sorted by name, at which that was seen last.
    """

    revision: int
    read: tuple[int, ...]

    def to_value(self) -> list[Any]:
        return [self.revision, list(self.read)]

    @staticmethod
    def parse(value: Any) -> ExpressionRevision:
        revision, read = read_fields(value, 2)
        if not isinstance(read, list):
            raise ValueError(f"list of revisions expected, found {shown(read)}")
        return ExpressionRevision(read_integer(revision, 1), tuple(map(read_integer, read)))


class OrderKind(enum.StrEnum):
    """What the operator may say. `ABORT` is absorbing."""

    RESUME = "resume"
    PAUSE = "pause"
    ABORT = "abort"


@dataclass(frozen=True, slots=True)
class Order(Record):
    """The operator's last word, as the author heard it."""

    kind: OrderKind
    stamp: int

    def rank(self) -> int:
        return int(self.kind is OrderKind.ABORT)

    def to_value(self) -> list[Any]:
        return [str(self.kind), self.stamp]

    @staticmethod
    def parse(value: Any) -> Order:
        kind, stamp = read_fields(value, 2)
        return Order(OrderKind(read_text(kind)), read_integer(stamp))


@dataclass(frozen=True, slots=True)
class Attempt(Record):
    """How many attempts of a Retry or Repeat are used up; joins by maximum."""

    number: int
    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        return self.number

    @staticmethod
    def parse(value: Any) -> Attempt:
        return Attempt(read_integer(value))


@dataclass(frozen=True, slots=True)
class ChildResult(Record):
    """How a child of a node with memory ended; success wins."""

    success: bool
    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        return int(self.success)

    def to_value(self) -> bool:
        return self.success

    @staticmethod
    def parse(value: Any) -> ChildResult:
        return ChildResult(read_boolean(value))


@dataclass(frozen=True, slots=True)
class MissionResult(Record):
    """How the mission has ended, and how many of its robots have agreed on it.

    Of what one author writes, the result that more have agreed on stands, then success.
    """

    success: bool
    agreed: int
    write_once: ClassVar[bool] = True

    def rank(self) -> int:
        return 2 * self.agreed + self.success

    def to_value(self) -> list[Any]:
        return [self.success, self.agreed]

    @staticmethod
    def parse(value: Any) -> MissionResult:
        success, agreed = read_fields(value, 2)
        return MissionResult(read_boolean(success), read_integer(agreed, 1, MAX_ROBOTS))


@dataclass(frozen=True, slots=True)
class Bid(Record):
    """What the author's performance would be, in micro-units; None: it has none to tell.

    The first one stands: a robot that starts again does not outbid itself.
    """

    performance: int | None
    write_once: ClassVar[bool] = True

    @staticmethod
    def parse(value: Any) -> Bid:
        return Bid(
            None if value is None else read_integer(value, -MAX_PERFORMANCE, MAX_PERFORMANCE)
        )


@dataclass(frozen=True, slots=True)
class Latch(Record):
    """Something that stays true once said: a verdict of failure, a grant, a broken coalition."""

    write_once: ClassVar[bool] = True

    @staticmethod
    def parse(value: Any) -> Latch:
        if value is not True:
            raise ValueError("a latch can only be true")
        return Latch()


MEMBER, CLAIM, ORDER, RESULT = "member", "claim", "order", "result"
OUTCOME, CONDITION, ATTEMPT = "outcome", "condition", "attempt"
VERDICT, EXPIRED = "verdict", "expired"
# Of an expression of conditions that is a guard.
EXPRESSION = "expression"
# Of one coalition of one activation, named by its token. BROKEN: too few members are left.
# GRANT: the author has granted it an exclusive task. DOUBT: that grant has ended, and nobody
# knows how far the work got. CLEARED: it never began, or the operator lets it be tried again.
COALITION, BROKEN, GRANT, DOUBT, CLEARED = "coalition", "broken", "grant", "doubt", "cleared"
# A child of a node with memory has ended: scope of the node, position of the child.
CHILD_RESULT = "passed"
# The operator's word that an activation in doubt was done.
DONE = "done"
# For one local task of an activation: the author's bid; nobody's bid is waited for any more.
BID, CLOSED = "bid", "closed"
# What is wrong with a part of the author's program.
PROBLEM = "problem"

_PARSERS: Mapping[str, Callable[[Any], Record]] = {
    MEMBER: Member.parse,
    CLAIM: parse_claim,
    ORDER: Order.parse,
    RESULT: MissionResult.parse,
    OUTCOME: Outcome.parse,
    CONDITION: ConditionValue.parse,
    EXPRESSION: ExpressionRevision.parse,
    ATTEMPT: Attempt.parse,
    CHILD_RESULT: ChildResult.parse,
    COALITION: Coalition.parse,
    BID: Bid.parse,
    PROBLEM: RobotProblem.parse,
    **dict.fromkeys((VERDICT, EXPIRED, BROKEN, GRANT, DOUBT, CLEARED, DONE, CLOSED), Latch.parse),
}
COALITION_KINDS = frozenset({COALITION, BROKEN, GRANT, DOUBT, CLEARED})
EXCLUSIVE_KINDS = frozenset({GRANT, DOUBT, CLEARED, DONE})
BID_KINDS = frozenset({BID, CLOSED})
# kind / condition, scope or activation / local task, token or position / token of an outcome
_PARTS: Mapping[str, tuple[int, ...]] = {
    MEMBER: (1,),
    CLAIM: (1,),
    ORDER: (1,),
    RESULT: (1,),
    OUTCOME: (3, 4),
    CHILD_RESULT: (3,),
    **dict.fromkeys(sorted(COALITION_KINDS | BID_KINDS), (3,)),
}


def split_name(name: str) -> tuple[str, ...]:
    """The parts of an entry's name: kind first; raises ValueError if it is none."""
    return _split(read_text(name, MAX_NAME))


# Each name is read several times, by every robot that is simulated in one process.
@lru_cache(maxsize=4_096)
def _split(name: str) -> tuple[str, ...]:
    parts = tuple(name.split("/"))
    if parts[0] not in _PARSERS or len(parts) not in _PARTS.get(parts[0], (2,)):
        raise ValueError(f"no kind of fact has the name {shown(name)}")
    return parts


def parse_record(name: str, value: Any) -> tuple[tuple[str, ...], Record]:
    """The parts of an entry's name, and its record; raises ValueError if one is malformed."""
    parts = split_name(name)
    return parts, _PARSERS[parts[0]](value)
