"""The facts that an evaluation reads, and its result."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from mrbt_mesh.core.bt.tree import Status, Tree

_STATUSES = tuple(Status)
# By status: which of those of several jobs is shown.
_URGENCY = (0, 3, 1, 2)


class EvaluationFacts(Protocol):
    """What a tree may read. The team's facts (T_G) and a robot's own (T_A, T_Li) provide it."""

    @property
    def run(self) -> str:
        """The run's id, a part of every activation's name."""
        ...

    def condition(self, name: str) -> bool:
        """Whether the condition holds."""
        ...

    def turns(self, name: str, value: bool) -> int:
        """How often a condition, or an expression by its id, has turned to `value`; never falls."""
        ...

    def task_status(self, subject: str, activation: str) -> Status:
        """RUNNING until the activation has a result."""
        ...

    def attempts_used(self, activation: str) -> int:
        """How many attempts of a Retry or Repeat are used up."""
        ...

    def has_expired(self, activation: str) -> bool:
        """Whether a Timeout's time is over."""
        ...

    def child_result(self, activation: str, position: int) -> Status | None:
        """How that child of a node with memory ended, None if that is not known."""
        ...

    def jobs_status(self, origin: int) -> Status:
        """RUNNING, or how that Jobs node was ended by one of its jobs."""
        ...


class PresentFacts:
    """Present facts alone: nothing has turned, ended or been counted before."""

    run = ""

    def turns(self, name: str, value: bool) -> int:
        return 0

    def attempts_used(self, activation: str) -> int:
        return 0

    def has_expired(self, activation: str) -> bool:
        return False

    def child_result(self, activation: str, position: int) -> Status | None:
        return None

    def jobs_status(self, origin: int) -> Status:
        return Status.RUNNING


@dataclass(slots=True)
class OwnFacts(PresentFacts):
    """The conditions that hold, and the statuses of actions; those that are not named run."""

    true_conditions: Collection[str]
    actions: Mapping[str, Status] = field(default_factory=dict)

    def condition(self, name: str) -> bool:
        return name in self.true_conditions

    def task_status(self, subject: str, activation: str) -> Status:
        return self.actions.get(subject, Status.RUNNING)


@dataclass
class OverlaidFacts:
    """Reads as the facts beneath, but for the methods that a subclass overrides."""

    beneath: EvaluationFacts

    @property
    def run(self) -> str:
        return self.beneath.run

    def condition(self, name: str) -> bool:
        return self.beneath.condition(name)

    def turns(self, name: str, value: bool) -> int:
        return self.beneath.turns(name, value)

    def task_status(self, subject: str, activation: str) -> Status:
        return self.beneath.task_status(subject, activation)

    def attempts_used(self, activation: str) -> int:
        return self.beneath.attempts_used(activation)

    def has_expired(self, activation: str) -> bool:
        return self.beneath.has_expired(activation)

    def child_result(self, activation: str, position: int) -> Status | None:
        return self.beneath.child_result(activation, position)

    def jobs_status(self, origin: int) -> Status:
        return self.beneath.jobs_status(origin)


@dataclass
class OtherConditions(OverlaidFacts):
    """Facts with other values of some conditions, and other counts of some guards' turns: as they
    were before, or as one robot reads its own.
    """

    values: Mapping[str, bool]
    counts: Mapping[tuple[str, bool], int]

    def condition(self, name: str) -> bool:
        value = self.values.get(name)
        return super().condition(name) if value is None else value

    def turns(self, name: str, value: bool) -> int:
        count = self.counts.get((name, value))
        return super().turns(name, value) if count is None else count


class OutcomeTick:
    """Facts in the tick in which an action returns: before its outcome, with that outcome and the
    conditions that are set with it. `EvaluationFacts`; to be evaluated once.

    An action that sets conditions does so before it returns. That tick goes through the tree from
    the left, so nodes left of the action have read the conditions before, and nodes right of it
    read them afterwards. `status`: that of the outcome's activation from then on. `conditions`: the
    values from then on, by the names that the tree reads.
    """

    def __init__(
        self,
        facts: EvaluationFacts,
        activation: str,
        status: Status,
        conditions: Mapping[str, bool],
    ) -> None:
        self.conditions = conditions
        self.run = facts.run
        self.turns = facts.turns
        self.attempts_used = facts.attempts_used
        self.has_expired = facts.has_expired
        self.child_result = facts.child_result
        self.jobs_status = facts.jobs_status
        self.beneath = facts
        self._activation = activation
        self._status = status
        self._has_returned = False

    def condition(self, name: str) -> bool:
        value = self.conditions.get(name) if self._has_returned else None
        return self.beneath.condition(name) if value is None else value

    def task_status(self, subject: str, activation: str) -> Status:
        if activation != self._activation:
            return self.beneath.task_status(subject, activation)
        self._has_returned = True
        return self._status


@dataclass(frozen=True, slots=True)
class Request:
    """A running action leaf: its global or local task, and its activation."""

    node: int
    subject: str
    activation: str


@dataclass(frozen=True, slots=True)
class RunningTimeout:
    """A Timeout whose child runs; the first to see `timeout_us` pass records that it expired."""

    node: int
    activation: str
    timeout_us: int


class JobEnded(NamedTuple):
    """A job's tree has succeeded or failed; `failures`: activations of its actions that failed."""

    job: str
    success: bool
    failures: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What one tick has found: a status per node, requests in tree order, facts to write.

    `status`: that of the root. `statuses` has one byte per node, the value of its `Status`. Facts
    that have become true:
    `attempts`, pairs (activation of a loop, attempts used up), and `child_results`, triples
    (activation of a node with memory, position, success). `failures`: activations of the actions
    that were ticked and have failed, except in attempts that are used up. `job_ends`: the jobs that
    have ended. `tree`: the one that was ticked, with the jobs that were in it.
    """

    status: Status
    statuses: bytes
    requests: tuple[Request, ...]
    timeouts: tuple[RunningTimeout, ...]
    attempts: tuple[tuple[str, int], ...]
    failures: tuple[str, ...]
    child_results: tuple[tuple[str, int, bool], ...]
    job_ends: tuple[JobEnded, ...]
    tree: Tree = field(repr=False, compare=False)

    def status_of(self, node: int) -> Status:
        """The status of one node."""
        return _STATUSES[self.statuses[node]]

    def declared_statuses(self, declared: Tree) -> bytes:
        """The statuses of the nodes of the mission file's tree: below Jobs, of each node the one
        that matters most among those of all jobs.
        """
        if self.tree is declared:
            return self.statuses
        found = bytearray(len(declared.nodes))
        for node in self.tree.nodes:
            status = self.statuses[node.index]
            if _URGENCY[status] > _URGENCY[found[node.origin]]:
                found[node.origin] = status
        return bytes(found)

    def origin_of(self, request: Request) -> int:
        """The node of a request in the mission file's tree."""
        return self.tree.nodes[request.node].origin
