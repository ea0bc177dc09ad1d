"""Facts that follow from other facts: which these are, and when one tells nothing new.

They are written to be cheap to read and short to keep: their causes may be dropped. One robot's
word for them is not enough (`membership.unproved`). Used up attempts and results of children of
nodes with memory are not among them: a robot that knows of fewer outcomes than others may see one
that the others never will.
"""

from __future__ import annotations

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    AdoptedMission,
    JobArchive,
    JobEnd,
    JobState,
    MissionResult,
    Record,
)
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts

DERIVED_KINDS = frozenset(
    {
        records.BROKEN,
        records.CLOSED,
        records.EXPIRED,
        records.JOB_ARCHIVE,
        records.JOB_DUE,
        records.JOB_END,
        records.LATCHED_FAILURE,
        records.MISSION_ADOPTED,
        records.RESULT,
    }
)
# Those that a robot which was alone may have seen, and others never can: the alive set, a condition
# or a deadline was another one there.
WITNESSED_KINDS = frozenset(
    {
        records.BROKEN,
        records.CLOSED,
        records.EXPIRED,
        records.LATCHED_FAILURE,
        records.RESULT,
    }
)


def follows_from_others(entry: Entry) -> bool:
    """True for a fact that follows from others; a cancellation is an operator's."""
    record = entry.record
    is_cancellation = isinstance(record, JobEnd) and record.state is JobState.CANCELLED
    return entry.parts[0] in DERIVED_KINDS and not is_cancellation


def is_known(facts: TeamFacts, entry: Entry) -> bool:
    """True if the facts say the same already, so that this entry tells nothing new."""
    name, record, jobs = entry.name, entry.record, facts.jobs
    if isinstance(record, AdoptedMission) and int(entry.parts[1]) < facts.declared.revision_number:
        return True
    if isinstance(record, JobArchive):
        return jobs is not None and jobs.knows_archive(int(entry.parts[1]), record)
    if isinstance(record, JobEnd) and jobs is not None and jobs.has_ended(entry.parts[1]):
        known = jobs.known.get(entry.parts[1])
        end = known.end if known is not None else None
        return end is None or end.rank() >= record.rank()
    others = (facts.map.get(author, name) for author in facts.map.authors())
    return any(other is not None and says(other.record, record) for other in others)


def says(known: Record, claimed: Record) -> bool:
    """True if the second record says no more than the first, of the same name."""
    match claimed:
        case JobEnd():
            if not isinstance(known, JobEnd) or known.rank() > claimed.rank():
                return isinstance(known, JobEnd)
            return (known.state, known.robots) == (claimed.state, claimed.robots)
        case MissionResult(success, agreed):
            return (
                isinstance(known, MissionResult)
                and known.success >= success
                and known.agreed >= agreed
            )
    return known == claimed
