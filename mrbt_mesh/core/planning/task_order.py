"""The order of tasks that schedules have to respect: which have priority, and which came first.

What is left of a Jobs node goes before its jobs, these by priority, and what is right of it last:
these are *levels*. Within a level jobs come as they arrived, and attempts of loops by their number.
Tasks of one job, and those that a tree asks for in the same attempts, come together: their order is
left to the objective.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts.team_facts import TeamFacts

_Key = TypeVar("_Key", bound=tuple[Any, ...])


class OrderKey(NamedTuple):
    """Where a task is in the order, smaller first. `deadline_us`: of its job, 0 without."""

    level: int
    arrival: int
    deadline_us: int


def task_order(facts: TeamFacts, requests: Sequence[Request]) -> Mapping[str, OrderKey]:
    """The place of each request, by activation; levels and arrivals are numbered from 0."""
    nodes, jobs = facts.mission.tree.nodes, facts.jobs
    jobs_nodes = [node.index for node in nodes if node.kind is Kind.JOBS] if jobs else []
    keys: dict[str, tuple[tuple[int, int], tuple[int, str], int]] = {}
    for request in requests:
        # How many Jobs nodes begin before it: it is in the last of them, or right of it.
        count = 2 * bisect_right(jobs_nodes, request.node)
        activation = parse_activation(request.activation)
        known = jobs.known.get(activation.job) if jobs is not None and activation.job else None
        job = known.job if known is not None else None
        if known is None or job is None:
            keys[request.activation] = (count, 0), (sum(activation.attempts), ""), 0
        else:
            level = count - 1, -known.priority
            keys[request.activation] = level, (known.arrival, known.id), job.deadline_us
    levels = _numbered({level for level, _, _ in keys.values()})
    arrivals = _numbered({(level, arrival) for level, arrival, _ in keys.values()})
    return {
        name: OrderKey(levels[level], arrivals[level, arrival], deadline_us)
        for name, (level, arrival, deadline_us) in keys.items()
    }


def _numbered(keys: Collection[_Key]) -> dict[_Key, int]:
    return {key: number for number, key in enumerate(sorted(keys))}
