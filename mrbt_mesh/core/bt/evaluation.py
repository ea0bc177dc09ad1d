"""What an evaluation reads and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from mrbt_mesh.core.bt.tree import Status

_STATUSES = tuple(Status)


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
    """What one tick has found: a status per node, requests in tree order, facts to write.

    `statuses` has one byte per node, the value of its `Status`. Facts that have become true:
    `attempts`, pairs (activation of a loop, attempts used up), and `child_results`, triples
    (activation of a node with memory, position, success). `failures`: activations of the actions
    that were ticked and have failed, except in attempts that are used up.
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
