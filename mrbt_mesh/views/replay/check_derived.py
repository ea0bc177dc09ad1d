"""Checks facts that follow from other facts: the end of a job, when it is due, the result of all.

A robot writes these for the whole team, so its own word is not enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import JobEnd, JobState, MissionResult, Outcome
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.job_ends import job_ends
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.views.replay.checked_recording import CheckedRecording, RecordedFact

# The clocks of a team's computers may differ by this much.
CLOCKS_US = 5_000_000
# A recording with an earlier epoch, in nanoseconds since 1970, is in virtual time.
_REAL_NS = 10**18


class DerivedCheck:
    """Call `planned` with each plan and its facts, and `own` with each fact of the robot itself."""

    def __init__(self) -> None:
        self._facts: TeamFacts | None = None
        self._plan: Plan | None = None
        # The jobs that have ended by the last plan and its facts: how, and who worked on them.
        self._ends: dict[str, tuple[JobState, tuple[str, ...]]] = {}
        # When its last outcome was written.
        self._outcome_us: int | None = None

    def planned(self, facts: TeamFacts, plan: Plan) -> None:
        """Note that this plan was computed from these facts."""
        self._facts, self._plan, self._ends = facts, plan, {}
        if facts.jobs is None:
            return
        ends = [(f"{records.JOB_END}/{k.id}", k.written_end) for k in facts.jobs.unsettled()]
        for name, record in [*job_ends(facts, plan.evaluation), *ends]:
            if isinstance(record, JobEnd):
                self._ends[name] = record.state, record.robots

    def own(self, entry: Entry, at_us: int) -> None:
        """Check a fact of the robot itself.

        Raises ValueError if it follows neither from the plan before it nor from an outcome of the
        same moment: the tick of an outcome is part of no plan.
        """
        record = entry.record
        if isinstance(record, JobEnd) and record.state is JobState.CANCELLED:
            self._check_cancelled(entry.parts[1])
        if isinstance(record, Outcome):
            self._outcome_us = at_us
        if at_us == self._outcome_us:
            return
        if isinstance(record, JobEnd) and record.state in (JobState.SUCCEEDED, JobState.FAILED):
            if self._ends.get(entry.name) != (record.state, record.robots):
                robots = ", ".join(record.robots) or "nobody"
                text = f"{entry.author} writes that {entry.parts[1]} has {record.state} by {robots}"
                raise ValueError(f"{text}, which does not follow from the facts")
        elif isinstance(record, MissionResult) and self._plan is not None:
            wanted = Status.SUCCESS if record.success else Status.FAILURE
            if self._plan.result is not wanted:
                raise ValueError(f"{entry.author} writes a result that its plan does not have")

    def _check_cancelled(self, name: str) -> None:
        jobs = self._facts.jobs if self._facts is not None else None
        known = jobs.known.get(name) if jobs is not None else None
        if known is None or not known.is_cancelled:
            raise ValueError(f"no operator has cancelled {name}")


def early(checks: Sequence[CheckedRecording]) -> Iterator[tuple[CheckedRecording, RecordedFact]]:
    """Yield facts that jobs were due or had expired which came too early in all recordings with
    them.
    """
    known: dict[tuple[str, str], list[tuple[int, CheckedRecording, RecordedFact]]] = {}
    for check in checks:
        epoch_ns = check.recording.metadata.epoch_ns
        for fact, due_us in check.timed if epoch_ns >= _REAL_NS else ():
            late_us = epoch_ns // 1_000 + fact.at_us - due_us
            known.setdefault((fact.author, fact.name), []).append((late_us, check, fact))
    for rows in known.values():
        if max(late_us for late_us, _, _ in rows) < -CLOCKS_US:
            _, check, fact = rows[0]
            yield check, fact


def due_us(facts: TeamFacts, entry: Entry) -> int | None:
    """Return the Unix time before which this fact about a job is false; None: there is none."""
    jobs, kind = facts.jobs, entry.parts[0]
    known = jobs.known.get(entry.parts[1]) if jobs is not None and len(entry.parts) > 1 else None
    job = known.job if known is not None else None
    if job is None:
        return None
    if kind == records.JOB_DUE:
        return job.not_before_us or None
    is_expired = isinstance(entry.record, JobEnd) and entry.record.state is JobState.EXPIRED
    return job.deadline_us or NEVER_DUE_US if is_expired else None


# A job without a deadline does not expire.
NEVER_DUE_US = 1 << 62
