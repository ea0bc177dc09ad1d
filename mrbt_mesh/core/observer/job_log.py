"""What an observer has seen of each job: its times, attempts, and what its tasks have found out."""

from __future__ import annotations

from dataclasses import dataclass, field

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.jobs import job_of
from mrbt_mesh.core.facts.records import Claim, ConditionValue, Job, JobEnd, OperatorCommand, Phase
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import split_owner

# More than are open at a time, and of how many the ends are kept.
MOST_JOBS = 25_000


@dataclass(slots=True)
class JobHistory:
    """One job. Times are on the observer's clock, None if they passed before it watched.

    `not_before_us`, `deadline_us`: Unix times, 0: none. `attempts`: how often its tree has begun.
    `results`: the job's own entries of the blackboard that were set, as texts.
    """

    submitted_us: int | None = None
    begun_us: int | None = None
    ended_us: int | None = None
    has_begun: bool = False
    has_ended: bool = False
    not_before_us: int = 0
    deadline_us: int = 0
    attempts: int = 0
    results: dict[str, str] = field(default_factory=dict)
    _unix: dict[str, int] = field(default_factory=dict)

    def unix_us(self, name: str, clock_offset_us: int | None) -> int | None:
        """One of the times as a Unix time, by the clock that is so much ahead when it is asked for
        first; None: it is not known.
        """
        at_us = getattr(self, f"{name}_us")
        if at_us is None or clock_offset_us is None:
            return None
        return self._unix.setdefault(name, at_us + clock_offset_us)


class JobLog:
    """The jobs by id; of those that ended long ago the oldest are forgotten."""

    def __init__(self, mission: Mission) -> None:
        self.jobs: dict[str, JobHistory] = {}
        self.revised(mission)

    def revised(self, mission: Mission) -> None:
        """This is the mission in force now."""
        self._mission = mission

    def fact(self, entry: Entry, now_us: int, is_older: bool) -> None:
        """An entry of the fact map has changed; `is_older`: perhaps before the run was watched."""
        at_us = None if is_older else now_us
        match entry.record:
            case Claim(activation=name, phase=phase):
                self._claimed(name, phase, at_us)
            case OperatorCommand(value=Job(not_before_us=begins_us, deadline_us=ends_us)):
                history = self._of(entry.parts[1])
                history.submitted_us = at_us
                history.not_before_us, history.deadline_us = begins_us, ends_us
            case OperatorCommand() if entry.parts[0] == records.JOB_CANCELLED:
                self._ended(entry.parts[1], at_us)
            case JobEnd():
                self._ended(entry.parts[1], at_us)
            case ConditionValue(value=value) if of_job := job_of(entry):
                name = split_owner(entry.parts[1])[0]
                self._of(of_job).results[name] = self._mission.entry_text(entry.parts[1], value)

    def _claimed(self, name: str, phase: Phase, at_us: int | None) -> None:
        activation = parse_activation(name)
        if not activation.job:
            return
        history = self._of(activation.job)
        if phase is not Phase.CLAIMED and not history.has_begun:
            history.has_begun, history.begun_us = True, at_us
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

    def _ended(self, job: str, at_us: int | None) -> None:
        history = self._of(job)
        if not history.has_ended:
            history.has_ended, history.ended_us = True, at_us

    def _of(self, job: str) -> JobHistory:
        if job not in self.jobs and len(self.jobs) >= MOST_JOBS:
            del self.jobs[next((n for n, each in self.jobs.items() if each.has_ended), job)]
        return self.jobs.setdefault(job, JobHistory())
