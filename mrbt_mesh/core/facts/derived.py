"""Facts that follow from others: which of them wait for proof, and when one says nothing new.

They are written because they are cheap to read and short to keep, while their causes may be
dropped. One robot's word for them is not enough (`membership.unproved`). Other derived facts join
the map at once. Ends of jobs count only as far as the map supports them (`KnownJob.written_end`).
Facts that a robot which was cut off, or knows fewer outcomes, may see and others never will are
believed: attempts used up, results of children of nodes with memory, expired timeouts, parties that
are broken up.
"""

from __future__ import annotations

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import JobArchive, MissionResult, Record
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.feature import features

# Kinds that a robot which was alone may have seen while others never can, because its alive set or
# a condition was different.
WITNESSED_KINDS = frozenset({records.LATCHED_FAILURE, records.RESULT})
DERIVED_KINDS = WITNESSED_KINDS.union(
    {records.JOB_ARCHIVE, records.JOB_DUE}, *(feature.derived for feature in features())
)


def follows_from_others(entry: Entry) -> bool:
    """True for a fact that waits until other facts show it, or another robot holds it."""
    return entry.parts[0] in DERIVED_KINDS


def is_known(facts: TeamFacts, entry: Entry) -> bool:
    """True if the facts already say the same, so that this entry adds nothing."""
    name, record, jobs = entry.name, entry.record, facts.jobs
    if (index := facts.index_of(entry)) is not None and index.says(entry):
        return True
    if isinstance(record, JobArchive):
        return jobs is not None and jobs.knows_archive(int(entry.parts[1]), record)
    others = (facts.map.get(author, name) for author in facts.map.authors())
    return any(other is not None and says(other.record, record) for other in others)


def says(known: Record, claimed: Record) -> bool:
    """True if `claimed` says no more than `known`, a record of the same name."""
    if isinstance(known, MissionResult) and isinstance(claimed, MissionResult):
        return known.success >= claimed.success and known.agreed >= claimed.agreed
    return known == claimed
