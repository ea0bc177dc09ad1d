"""Conditions that every robot has for itself: which robots are eligible, and what a dead one loses.

A request behind such a condition is for the robots for which it holds: with a robot's own values in
place of the team's, each guard of the request must have its status. A guard that fails for the team
as well asks for nothing: something else has let the team through, such as the outcome of `pick` in
Fallback(holding, pick).

The tree never reads who is alive (`pending_failures`), but what a dead robot held is lost to the
team, and another one may have to fetch it again. So a robot's own conditions become false once the
plan has left it out for `Timing.failure_latch_us` and all report the same plan. The first robot
that sees the time pass writes it; all would write the same. A robot that comes back writes its own
again (`Contradiction`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial

from mrbt_mesh.core.bt.evaluation import OtherConditions, Request
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.feature import PlanStep
from mrbt_mesh.core.mission.names import robot_condition
from mrbt_mesh.core.planning.plan import PendingLoss


class OwnStep(PlanStep):
    """Has plans heed the conditions that every robot has for itself."""

    def eligible(self, facts: TeamFacts, request: Request) -> tuple[str, ...] | None:
        """See `PlanStep`: the robots that find the guards of a request as they must be.

        Sorted by id, dead ones included.
        """
        guards = facts.mission.entries.guards.get(request.node)
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

    def asked_for(self, facts: TeamFacts, request: Request) -> str:
        """See `PlanStep`: ` with holding`."""
        entries = facts.mission.entries
        own: set[str] = set()
        for name, _ in entries.guards.get(request.node, ()):
            own.update(filter(entries.is_own, entries.read_by(name)))
        return f" with {', '.join(sorted(own))}" if own else ""

    def losses(self, facts: TeamFacts, team: Collection[str]) -> Sequence[PendingLoss]:
        """See `PlanStep`: what holds for robots of the mission that are not in the team, sorted."""
        entries = facts.mission.entries
        absent = sorted(robot for robot in facts.mission.robots if robot not in team)
        names = [robot_condition(read, robot) for read in entries.read for robot in absent]
        lost = {name: None if entries.is_value(name) else False for name in names}
        return [
            PendingLoss(name, facts.conditions.changes(name) + 1, value)
            for name, value in lost.items()
            if facts.conditions.entry(name) != value
        ]


def _finds(facts: TeamFacts, value: Callable[[str], bool], name: str) -> bool:
    """Whether a condition or expression holds, with these values of conditions."""
    if facts.mission.entries.is_own(name):
        return value(name)
    guard = facts.mission.evaluator.with_actions.get(name)
    if guard is not None:
        read = OtherConditions(facts, {each: value(each) for each in guard.conditions}, {})
        return facts.mission.evaluator.status_at(guard.node, read) is not guard.wanted
    expression = facts.mission.entries.expressions[name]
    holding = set(filter(value, expression.conditions))
    return facts.mission.evaluator.holds(expression, holding)
