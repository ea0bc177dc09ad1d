"""What an observer has seen of each job: its times, attempts, and what its tasks have found out;
and of all jobs of a type, how many have come to which end.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.jobs import job_of
from mrbt_mesh.core.facts.records import (
    Claim,
    ConditionValue,
    Hold,
    Job,
    JobEnd,
    JobState,
    OperatorCommand,
    Outcome,
    Phase,
)
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import split_owner
from mrbt_mesh.observer.job_history import JobHistory, JobTotals
from mrbt_mesh.observer.work_log import WorkSpan

# Of so many jobs that have ended the histories are kept: of more than the team keeps the ends.
MOST_ENDED = 2_000


class JobLog:
    """The jobs by id; of those that ended long ago the oldest are forgotten, but counted.

    `over_us`: from then on nobody did an open job any more, as the mission was over or aborted;
    None: not (yet), or that is not known.

    `clock_ahead_us`: by how much the team's clocks are ahead of the observer's; None: not known.
    """

    def __init__(
        self, mission: Mission, clock_ahead_us: Callable[[], int | None] = lambda: None
    ) -> None:
        self.jobs: dict[str, JobHistory] = {}
        self.over_us: int | None = None
        self._clock_ahead_us = clock_ahead_us
        self._forgotten: dict[str, JobTotals] = {}
        # Those that have ended, in that order.
        self._over: dict[str, None] = {}
        self.revised(mission)

    def revised(self, mission: Mission) -> None:
        """This is the mission in force now."""
        self._mission = mission

    def over(self, now_us: int) -> None:
        """The mission is over, or was aborted."""
        self.over_us = now_us if self.over_us is None else self.over_us

    def ended_us(self, history: JobHistory) -> int | None:
        """When the job has ended, also by the end of the mission; None: not (yet), or that is not
        known.
        """
        return history.ended_us if history.has_ended else self.over_us

    def at_work(self, span: WorkSpan) -> None:
        """A living robot has a claim, perhaps of a job."""
        job = parse_activation(span.activation).job
        if job and span.at_work_us is not None:
            self._of(job).at_work(span)

    def fact(self, entry: Entry, now_us: int, is_older: bool) -> None:
        """An entry of the fact map has changed; `is_older`: perhaps before the run was watched."""
        at_us = None if is_older else now_us
        match entry.record:
            case Outcome() if is_older and (job := parse_activation(entry.parts[1]).job):
                self._of(job).is_older = True
            case Claim(activation=name, phase=phase):
                self._claimed(entry.author, name, phase, at_us)
            case OperatorCommand(value=Job() as job):
                self._submitted(self._of(entry.parts[1]), job, at_us)
            case OperatorCommand(value=int(priority)) if entry.parts[0] == records.JOB_PRIORITY:
                self._of(entry.parts[1]).priority = priority
            case OperatorCommand(value=Hold() as hold) if entry.parts[0] == records.JOB_HOLD:
                history = self._of(entry.parts[1])
                history.is_older |= is_older
                history.held(hold is not Hold.RELEASED, now_us)
            case OperatorCommand() if entry.parts[0] == records.JOB_CANCELLED:
                self._ended(entry.parts[1], at_us).ends(JobState.CANCELLED, ())
            case JobEnd() as end:
                history = self._ended(entry.parts[1], at_us)
                history.type = history.type or end.type
                if end.state is not JobState.CANCELLED:  # which no robot's word can do
                    history.ends(end.state, end.robots)
            case ConditionValue(value=value) if of_job := job_of(entry):
                name = split_owner(entry.parts[1])[0]
                self._of(of_job).results[name] = self._mission.entries.text(entry.parts[1], value)

    def _submitted(self, history: JobHistory, job: Job, at_us: int | None) -> None:
        if at_us is not None and history.begun_us is not None:
            # The robot that began it was heard before the one that the job was handed to.
            at_us = min(at_us, history.begun_us)
        history.type = history.type or job.type
        history.submitted_us = at_us
        history.not_before_us, history.deadline_us = job.not_before_us, job.deadline_us
        if not job.not_before_us:
            history.ready_us = at_us
        if history.priority is None:
            history.priority = job.priority

    def _claimed(self, robot: str, name: str, phase: Phase, at_us: int | None) -> None:
        activation = parse_activation(name)
        if not activation.job:
            return
        history = self._of(activation.job)
        if phase is not Phase.CLAIMED:
            history.worked.add(robot)
            if not history.has_begun:
                history.has_begun, history.begun_us = True, at_us
                self._note_ready(history)
        used = activation.attempts[0] if self._is_retried(activation.node) else 0
        history.attempts = max(history.attempts, used + 1)

    def _is_retried(self, number: int) -> bool:
        """Whether the tree of a job that has this node is tried again as a whole."""
        names, nodes = self._mission.evaluator, self._mission.tree.nodes
        index = names.index_of.get((number, ""))
        loops = names.enclosing_loops[index] if index is not None else ()
        if not loops or nodes[loops[0]].kind is not Kind.RETRY:
            return False
        root = nodes[nodes[loops[0]].parent]  # of the type, which is a SubTree
        return nodes[root.parent].kind is Kind.JOBS

    def _ended(self, job: str, at_us: int | None) -> JobHistory:
        history = self._of(job)
        if not history.has_ended:
            history.has_ended, history.ended_us = True, at_us
            self._over[job] = None
            self._note_ready(history)
            if at_us is not None and history.deadline_us:
                ahead_us = self._clock_ahead_us()
                if ahead_us is not None:
                    history.late_us = max(0, at_us + ahead_us - history.deadline_us)
            self._forget_oldest()
        return history

    def _forget_oldest(self) -> None:
        if len(self._over) > MOST_ENDED:
            oldest = next(iter(self._over))
            del self._over[oldest]
            history = self.jobs.pop(oldest)
            self._forgotten.setdefault(history.type, JobTotals()).add(history, history.ended_us)

    def _note_ready(self, history: JobHistory) -> None:
        """Note when a job that begins or ends now was due, by the clocks as they are now."""
        submitted_us = history.submitted_us
        if history.ready_us is None and submitted_us is not None and history.not_before_us:
            ahead_us = self._clock_ahead_us()
            if ahead_us is not None:
                history.ready_us = max(submitted_us, history.not_before_us - ahead_us)

    def _of(self, job: str) -> JobHistory:
        return self.jobs.setdefault(job, JobHistory())

    def totals(self) -> dict[str, JobTotals]:
        """Type -> what came of all its jobs, by name."""
        found = deepcopy(self._forgotten)
        for history in self.jobs.values():
            if history.type:
                totals = found.setdefault(history.type, JobTotals())
                totals.add(history, self.ended_us(history))
        return dict(sorted(found.items()))
