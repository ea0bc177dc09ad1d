"""Sparing robots that others cannot replace: which robots a request may have.

For missions whose robots may break at work (`assignment: spare_scarce`). A robot that is the only
one left for something still to be done should not risk its life for what others can do too, even
if that has to wait until they are free. Choosing among equally good assignments only is not
enough: docs/explanation/robustness.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.mission.mission import Need
from mrbt_mesh.core.planning.capabilities import Worker
from mrbt_mesh.core.planning.demands import Demand
from mrbt_mesh.core.planning.side_constraints import feasibility

# For how many needs a robot is indispensable, then for how many one more could do it, ...
Value: TypeAlias = tuple[int, ...]


def spare_scarce(
    facts: TeamFacts,
    evaluation: Evaluation,
    demands: Sequence[Sequence[Demand]],
    team: Mapping[str, Worker],
) -> list[tuple[Demand, ...]]:
    """The demands with their candidates narrowed to the least needed robots, of equals all.

    A request that has been begun, or that those robots alone could not serve, keeps all its
    candidates. So whatever could be served by a team at rest still can, and nothing that could
    be done is blocked.
    """
    values = _values(facts, evaluation, team)
    result = []
    for group in demands:
        narrowed = tuple(_narrowed(demand, values) for demand in group)
        begun = any(demand.pinned for demand in group)
        check = feasibility(facts.mission.constraints, list(team), [narrowed])
        result.append(narrowed if not begun and check.keep(0, narrowed, {}) else tuple(group))
    return result


def _narrowed(demand: Demand, values: Mapping[str, Value]) -> Demand:
    """Without those robots that are needed more than the last one that it cannot do without."""
    if len(demand.candidates) <= demand.lower:
        return demand
    order = sorted(values[robot] for robot in demand.candidates)
    most = order[max(0, demand.lower - 1)]
    chosen = {robot: p for robot, p in demand.candidates.items() if values[robot] <= most}
    return replace(demand, candidates=chosen)


def _values(
    facts: TeamFacts, evaluation: Evaluation, team: Mapping[str, Worker]
) -> dict[str, Value]:
    """How much each robot is needed for what remains, to be compared from the left."""
    counts = {robot: [0] * len(team) for robot in team}
    for need, times in _remaining(facts, evaluation).items():
        able = [r for r, w in team.items() if capability(w.member, need.local_task) is not None]
        spare = max(0, len(able) - need.min_robots)
        for robot in able:
            counts[robot][spare] += times
    return {robot: tuple(row) for robot, row in counts.items()}


def _remaining(facts: TeamFacts, evaluation: Evaluation) -> dict[Need, int]:
    """The needs of all actions that may still be asked for: nothing above them has ended.

    Those that ask for nobody are none.
    """
    tree, found = facts.mission.tree, dict[Need, int]()
    ended: list[bool] = []
    for node in tree.nodes:  # parents come first
        over = evaluation.status_of(node.index) in (Status.SUCCESS, Status.FAILURE)
        ended.append(over or (node.parent >= 0 and ended[node.parent]))
        if not ended[-1] and node.subject in facts.mission.global_tasks:
            for need in facts.mission.global_tasks[node.subject].needs:
                if not need.min_robots:
                    continue
                found[need] = found.get(need, 0) + 1
    return found
