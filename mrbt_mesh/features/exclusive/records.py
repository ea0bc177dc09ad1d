"""Coalitions as their leaders write them down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from mrbt_mesh.core.facts.records import Plain, Record
from mrbt_mesh.core.facts.values import read_integer, read_text, shown
from mrbt_mesh.core.mission.mission import MAX_ROBOTS


def _read_members(value: Any) -> tuple[CoalitionMember, ...]:
    if not isinstance(value, list) or not 0 < len(value) <= MAX_ROBOTS:
        raise ValueError(f"a list of members expected, found {shown(value)}")
    return tuple(map(CoalitionMember.parse, value))


def _write_members(members: tuple[CoalitionMember, ...]) -> list[Any]:
    return [member.to_value() for member in members]


@dataclass(frozen=True, slots=True, order=True)
class CoalitionId:
    """Identifies a coalition by its leader, the leader's incarnation, and the leader's claim.

    `since`: the stamp of that claim. The order is the canonical one of claims.
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
class CoalitionMember(Record):
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
    """The robots that start one activation together, as written down by their leader."""

    members: Annotated[tuple[CoalitionMember, ...], Plain(_read_members, _write_members)]

    write_once: ClassVar[bool] = True
