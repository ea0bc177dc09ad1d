"""When a robot's facts show a fact that follows from others.

See `facts.derived` and `membership.unproved`. This is the definition by which robots, and those who
check their recordings, decide.
"""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.coalitions import newly_broken
from mrbt_mesh.core.facts.derived import is_known
from mrbt_mesh.core.facts.records import (
    AdoptedMission,
    CoalitionId,
    JobEnd,
    JobState,
    MissionResult,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.job_ends import robots_of


class DerivedFacts:
    """What these facts show. That a time is over is not among it: each robot measures that itself.

    `alive`: the robots that one counts on.
    """

    def __init__(
        self, facts: TeamFacts, evaluation: Evaluation, alive: Mapping[str, Incarnation]
    ) -> None:
        self._facts = facts
        self._evaluation = evaluation
        self._alive = alive

    def show(self, entry: Entry) -> bool:
        """True if this entry follows from the facts, or they say the same already."""
        return is_known(self._facts, entry) or self._follows(entry)

    def _follows(self, entry: Entry) -> bool:
        kind, evaluation = entry.parts[0], self._evaluation
        match entry.record:
            case JobEnd():
                return self._job_has_ended(entry.parts[1], entry.record)
            case MissionResult(success):
                return evaluation.status is (Status.SUCCESS if success else Status.FAILURE)
            case AdoptedMission(digest):
                return self._is_held_by_all(int(entry.parts[1]), digest)
        match kind:
            case records.LATCHED_FAILURE:
                return entry.parts[1] in evaluation.failures
            case records.BROKEN:
                return self._is_broken(entry)
        return False

    def _job_has_ended(self, name: str, end: JobEnd) -> bool:
        known = self._facts.jobs.known.get(name) if self._facts.jobs is not None else None
        job = known.job if known is not None else None
        if known is None or job is None:
            return False
        mine = job.type, job.arguments, known.commanded_by(records.JOB), job.content
        if mine != (end.type, end.arguments, end.operator, end.content):
            return False
        at_work = robots_of(self._facts, name)
        if not set(end.robots) <= set(at_work) or bool(end.robots) is not bool(at_work):
            return False
        if end.state not in (JobState.SUCCEEDED, JobState.FAILED):
            return False
        found = name, end.state is JobState.SUCCEEDED
        return found in [(ended.job, ended.success) for ended in self._evaluation.job_ends]

    def _is_held_by_all(self, number: int, digest: str) -> bool:
        revisions = self._facts.revisions
        pending = revisions.pending(self._facts.declared.revision_number)
        return (
            pending is not None
            and (pending[1].revision_number, pending[1].digest) == (number, digest)
            and revisions.is_held_by_all(pending[1], self._alive)
        )

    def _is_broken(self, entry: Entry) -> bool:
        """A member breaks its coalition by dropping out; of others it has to be seen."""
        facts, activation = self._facts, entry.parts[1]
        token, task = CoalitionId.parse(entry.parts[2]), facts.task_of(activation)
        members = facts.coalitions(activation).members.get(token, ())
        if entry.author == token.leader or any(m.robot == entry.author for m in members):
            return True
        return task is not None and token in newly_broken(facts, task, activation, self._alive, "")
