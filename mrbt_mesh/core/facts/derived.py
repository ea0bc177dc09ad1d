"""Facts that follow from others: which of these wait to be shown, and when one says nothing new.

They are written to be cheap to read and short to keep: their causes may be dropped. One robot's
word for them is not enough (`membership.unproved`). Others join the map at once: ends of jobs count
by the map alone (`KnownJob.written_end`), and what a robot that was apart, or knows of fewer
outcomes, may see and others never will, is believed: attempts that are used up, results of children
of nodes with memory, times that are over, broken coalitions.
"""

from __future__ import annotations

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import AdoptedMission, JobArchive, MissionResult, Record
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts

# Those that a robot which was alone may have seen, and others never can: the alive set or a
# condition was another one there.
WITNESSED_KINDS = frozenset({records.LATCHED_FAILURE, records.RESULT})
DERIVED_KINDS = WITNESSED_KINDS | {
    records.JOB_ARCHIVE,
    records.JOB_DUE,
    records.MISSION_ADOPTED,
}


def follows_from_others(entry: Entry) -> bool:
    """True for a fact that waits until others show it, or another robot holds it."""
    return entry.parts[0] in DERIVED_KINDS


def is_known(facts: TeamFacts, entry: Entry) -> bool:
    """True if the facts say the same already, so that this entry tells nothing new."""
    name, record, jobs = entry.name, entry.record, facts.jobs
    if isinstance(record, AdoptedMission) and int(entry.parts[1]) < facts.declared.revision_number:
        return True
    if isinstance(record, JobArchive):
        return jobs is not None and jobs.knows_archive(int(entry.parts[1]), record)
    others = (facts.map.get(author, name) for author in facts.map.authors())
    return any(other is not None and says(other.record, record) for other in others)


def says(known: Record, claimed: Record) -> bool:
    """True if the second record says no more than the first, of the same name."""
    if isinstance(known, MissionResult) and isinstance(claimed, MissionResult):
        return known.success >= claimed.success and known.agreed >= claimed.agreed
    return known == claimed
