"""What an evaluation reads and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from mrbt_mesh.core.bt.tree import Status

_STATUSES = tuple(Status)


class EvaluationFacts(Protocol):
    """What a tree may read. The team's facts and a robot's own facts both provide it."""

    @property
    def run(self) -> str: ...
    def condition(self, name: str) -> bool: ...
    def turns(self, name: str, value: bool) -> int:
        """How often the condition has turned to `value`; it never falls."""
        ...

    def task_status(self, subject: str, activation: str) -> Status:
        """RUNNING until the activation has a result."""
        ...

    def attempts_used(self, activation: str) -> int: ...
    def has_expired(self, activation: str) -> bool: ...
    def child_result(self, activation: str, position: int) -> Status | None:
        """How that child of a node with memory ended, None if nobody has said so."""
        ...


@dataclass(frozen=True, slots=True)
class Request:
    """A running action leaf: what it asks for, under which activation."""

    node: int
    subject: str
    activation: str


@dataclass(frozen=True, slots=True)
class RunningTimeout:
    """A Timeout whose child runs; whoever sees `timeout_us` pass records that it expired."""

    node: int
    activation: str
    timeout_us: int


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The outcome of one tick: a status per node, requests in tree order, facts to record.

    `statuses` has one byte per node, the value of its `Status`. `attempts` are (scope, attempt
    number) pairs that have become true by this evaluation, and `passed` (scope, position, success)
    of children that nodes with memory have done with; `failures` are the activations of the
    actions that were ticked and have failed, used-up attempts left out.
    """

    statuses: bytes
    requests: tuple[Request, ...]
    timeouts: tuple[RunningTimeout, ...]
    attempts: tuple[tuple[str, int], ...]
    failures: tuple[str, ...]
    child_results: tuple[tuple[str, int, bool], ...]

    @property
    def status(self) -> Status:
        """The root's status."""
        return _STATUSES[self.statuses[0]]

    def status_of(self, node: int) -> Status:
        """The status of one node."""
        return _STATUSES[self.statuses[node]]
