"""What entries about revisions mean."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar

from mrbt_mesh.core.facts.records import Plain, Reason, Record
from mrbt_mesh.core.facts.values import read_document
from mrbt_mesh.features.revisions.kinds import MAX_MISSION


@dataclass(frozen=True, slots=True)
class ProposedMission(Record):
    """A revision of the mission. `text`: the compiled mission. `is_forced`: apply it even if that
    cancels work or robots leave. `may_repeat`: apply it even if tasks that are done at most once,
    and were begun, are begun again (`features.revisions.objections`).
    """

    text: Annotated[str, Plain(partial(read_document, limit=MAX_MISSION))]
    is_forced: bool
    may_repeat: bool


@dataclass(frozen=True, slots=True)
class HeldMission(Record):
    """The revision that the author would take up, or why it does not. `digest`: empty for none.
    `in_force`: the revision that it acts by.
    """

    number: int
    digest: str
    problem: Reason
    in_force: int


@dataclass(frozen=True, slots=True)
class AdoptedMission(Record):
    """All robots have held this revision, so it is in force."""

    digest: str

    write_once: ClassVar[bool] = True
