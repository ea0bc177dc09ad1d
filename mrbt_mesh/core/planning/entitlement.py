"""Who may be asked: what conditions that every robot has for itself mean for a request.

A request behind such a condition is for the robots for which it holds: with a robot's own values in
place of the team's, each guard of the request has to be as it must. A guard that stands against the
team as well asks for nothing: something else has let the team through, such as the outcome of
`pick` in Fallback(holding, pick).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mrbt_mesh.core.bt.evaluation import OtherConditions, Request
from mrbt_mesh.core.facts.team_facts import TeamFacts


def entitled(facts: TeamFacts, request: Request) -> tuple[str, ...] | None:
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
    """What `entitled` goes by, for people: ` with holding`; empty if the request is for all."""
    mission = facts.mission
    own: set[str] = set()
    for name, _ in mission.per_robot.guards.get(request.node, ()):
        own.update(each for each in mission.per_robot.read_by(name) if each in mission.per_robot)
    return f" with {', '.join(sorted(own))}" if own else ""
