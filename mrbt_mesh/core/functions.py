"""The pure functions that cost an agent most of its time, as one bundle to be passed in.

Several agents in one process, as in the simulator, read the same messages and make the same
plans: they may share functions that remember their answers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from mrbt_mesh.core.assignment import Solver
from mrbt_mesh.core.evaluate import Evaluator
from mrbt_mesh.core.facts import Entry, Incarnation
from mrbt_mesh.core.plan import Plan
from mrbt_mesh.core.planning import PlanMaker
from mrbt_mesh.core.team import TeamFacts
from mrbt_mesh.core.wire import (
    Beat,
    Header,
    MessageKind,
    WireError,
    beat_body,
    decode,
    encode,
    parse_beat,
    parse_entries,
)

MakePlan: TypeAlias = Callable[[TeamFacts, Mapping[str, Incarnation]], Plan]
# What makes one robot's plans.
PlanMaking: TypeAlias = Callable[[Evaluator, Solver], MakePlan]
WriteBeat: TypeAlias = Callable[[Beat, Header], bytes]
# (robot under whose key it was published, message, own header, which relays may be news)
ReadBeat: TypeAlias = Callable[[str, bytes, Header, Callable[[list[Any]], bool]], Beat]
# (robot under whose key it was published, message, own header)
ReadBatch: TypeAlias = Callable[[str, bytes, Header], tuple[list[Entry], int]]


def plan_making(evaluator: Evaluator, solver: Solver) -> MakePlan:
    """Plans that follow one another: each uses what has not changed since the one before."""
    return PlanMaker(evaluator, solver).plan


def write_beat(beat: Beat, mine: Header) -> bytes:
    """A beat as a message."""
    return encode(mine, MessageKind.BEAT, beat_body(beat))


def read_beat(source: str, data: bytes, mine: Header, is_news: Callable[[list[Any]], bool]) -> Beat:
    """A published beat; relays that are no news may be left out. Raises WireError."""
    return parse_beat(_body(source, data, mine, MessageKind.BEAT), is_news)


def read_batch(source: str, data: bytes, mine: Header) -> tuple[list[Entry], int]:
    """(entries of a published batch, number of malformed ones left out). Raises WireError."""
    entries, malformed = parse_entries(_body(source, data, mine, MessageKind.FACT))
    if any(entry.author != source for entry in entries):
        raise WireError(f"{source} published entries of another author")
    return entries, malformed


def _body(source: str, data: bytes, mine: Header, kind: MessageKind) -> Any:
    sender, body = decode(data, mine, kind)
    if sender != source:
        raise WireError(f"sender {sender} published under the key of {source}")
    return body


@dataclass(frozen=True)
class Functions:
    """What an agent or an observer computes plans and reads messages with."""

    plan_making: PlanMaking = plan_making
    write_beat: WriteBeat = write_beat
    read_beat: ReadBeat = read_beat
    read_batch: ReadBatch = read_batch


# Each answer computed anew: what a robot does.
INDEPENDENT = Functions()
