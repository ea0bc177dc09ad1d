"""Conditions that every robot has for itself: which robots are eligible, and what a dead one loses.

A request behind such a condition is for the robots for which it holds: with a robot's own values in
place of the team's, each guard of the request must have its status. A guard that fails for the team
as well asks for nothing: something else has let the team through, such as the outcome of `pick` in
Fallback(holding, pick).

The tree never reads who is alive (`pending_failures`), but what a dead robot held is lost to the
team, and another one may have to fetch it again. So a robot's own conditions become false once the
plan has left it out for `Timing.failure_latch_us` and all report the same plan. The first robot
that sees the time pass writes it; all would write the same. A robot that comes back writes its own
again (`agent.reports`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial

from mrbt_mesh.core.bt.evaluation import OtherConditions, Request
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import ConditionValue
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.blackboard import Value
from mrbt_mesh.core.mission.names import robot_condition


def eligible(facts: TeamFacts, request: Request) -> tuple[str, ...] | None:
    """The robots that find the guards of a request as they must be; None: it is for all.

    Sorted by id, dead ones included.
    """
    guards = facts.mission.per_robot.guards.get(request.node)
    if guards is None:
        return None
    robots = sorted(facts.mission.robots)
    for name, against in guards:
        if _finds(facts, facts.condition, name) is not against:
            robots = [
                robot
                for robot in robots
                if _finds(facts, partial(facts.condition_of, robot), name) is not against
            ]
    return tuple(robots)


def _finds(facts: TeamFacts, value: Callable[[str], bool], name: str) -> bool:
    """Whether a condition or expression holds, with these values of conditions."""
    if name in facts.mission.per_robot:
        return value(name)
    guard = facts.mission.evaluator.with_actions.get(name)
    if guard is not None:
        read = OtherConditions(facts, {each: value(each) for each in guard.conditions}, {})
        return facts.mission.evaluator.status_at(guard.node, read) is not guard.wanted
    expression = facts.mission.per_robot.guard_expressions[name]
    holding = set(filter(value, expression.conditions))
    return facts.mission.evaluator.holds(expression, holding)


def asks_for(facts: TeamFacts, request: Request) -> str:
    """What `eligible` goes by, for people: ` with holding`; empty if the request is for all."""
    mission = facts.mission
    own: set[str] = set()
    for name, _ in mission.per_robot.guards.get(request.node, ()):
        own.update(each for each in mission.per_robot.read_by(name) if each in mission.per_robot)
    return f" with {', '.join(sorted(own))}" if own else ""


@dataclass(frozen=True, slots=True)
class PendingLoss:
    """A condition of a robot outside the team that becomes false, or an entry that is not set any
    more, as its `revision`, if every plan shows it for `Timing.failure_latch_us`.
    """

    condition: str
    revision: int
    value: Value | None = False

    @property
    def fact(self) -> Fact:
        """The fact that it is lost; the same, whichever robot writes it."""
        return f"{records.CONDITION}/{self.condition}", ConditionValue(self.value, self.revision, 0)


def pending_losses(facts: TeamFacts, team: Collection[str]) -> tuple[PendingLoss, ...]:
    """What holds for robots of the mission that are not in the team, sorted."""
    mission = facts.mission
    absent = sorted(robot for robot in mission.robots if robot not in team)
    names = [robot_condition(read, robot) for read in mission.per_robot.read for robot in absent]
    lost = {name: None if mission.holds_value(name) else False for name in names}
    return tuple(
        PendingLoss(name, facts.conditions.revision(name) + 1, value)
        for name, value in lost.items()
        if facts.conditions.entry(name) != value
    )
