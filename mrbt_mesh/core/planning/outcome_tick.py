"""The facts that follow from the tick in which an action returns.

Its robot writes them with the outcome. Conditions that it sets then are read in this tick by what
stands right of it alone, so they may not follow from the facts afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.derived import says
from mrbt_mesh.core.facts.records import (
    LATCH,
    Attempt,
    ChildResult,
    ConditionValue,
    MissionResult,
    Outcome,
)
from mrbt_mesh.core.facts.store import Entry, Fact
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.mission import MissionEnd
from mrbt_mesh.core.planning.job_ends import job_ends


def facts_of_tree(facts: TeamFacts, evaluation: Evaluation) -> list[Fact]:
    """The latched results of one tick of T_G."""
    latched: list[Fact] = [
        (f"{records.ATTEMPT}/{scope}", Attempt(number)) for scope, number in evaluation.attempts
    ]
    latched += [
        (f"{records.CHILD_RESULT}/{scope}/{position}", ChildResult(success))
        for scope, position, success in evaluation.child_results
    ]
    latched += [
        (f"{records.LATCHED_FAILURE}/{activation}", LATCH)
        for activation in evaluation.failures
        if not facts.has_latched_failure(activation)
    ]
    return latched


def mission_result(status: Status, agreed: int) -> list[Fact]:
    """The mission's result, if T_G has ended so; `agreed`: how many robots go by that."""
    if status not in (Status.SUCCESS, Status.FAILURE) or not agreed:
        return []
    return [(records.RESULT, MissionResult(status is Status.SUCCESS, agreed))]


def facts_of_tick(
    facts: TeamFacts,
    robot: str,
    activation: str,
    status: Status,
    values: Mapping[str, Value | None],
) -> list[Fact]:
    """The facts that follow from the tick in which a robot's action returns that has set conditions
    or other entries to these values.

    `status`: that of its activation from then on. Nodes with memory keep the results of that tick,
    and if T_G ends in it, so does the mission, unless it never does.
    """
    mission = facts.in_force
    after = {name: bool(value) for name, value in values.items()}
    if not mission.entries.is_plain:
        after = facts.conditions.after(values)
    evaluation = facts.mission.evaluator.evaluate_outcome(facts, activation, status, after)
    found = facts_of_tree(facts, evaluation)
    if evaluation.job_ends:
        found += job_ends(facts, evaluation, (parse_activation(activation).job, robot))
    if mission.ends is MissionEnd.ONCE:
        found += mission_result(evaluation.status, len(mission.robots))
    return found


def shown_by_tick(facts: TeamFacts, batch: Sequence[Entry]) -> set[str]:
    """The names of facts in a received batch that follow from the tick of the outcome in it.

    `facts`: those before the batch.
    """
    outcomes = [entry for entry in batch if isinstance(entry.record, Outcome)]
    if len(outcomes) != 1:
        return set()
    outcome, activation = outcomes[0], outcomes[0].parts[1]
    assert isinstance(outcome.record, Outcome)
    if facts.task_of(activation) is None:
        return set()
    success = outcome.record.success
    status = facts.status_after(outcome.name, outcome.author, success, outcome.version)
    values = {e.parts[1]: e.record.value for e in batch if isinstance(e.record, ConditionValue)}
    found = dict(facts_of_tick(facts, outcome.author, activation, status, values))
    return {e.name for e in batch if e.name in found and says(found[e.name], e.record)}
