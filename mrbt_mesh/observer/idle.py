"""Why robots have nothing to do, in sentences for people. Plans only say which robots these are."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from mrbt_mesh.core.facts.records import TeamOrder
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.capabilities import workers
from mrbt_mesh.core.planning.demands import Group
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.schedules import Lookahead


def why_idle(plan: Plan, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> dict[str, str]:
    """Robot -> why the plan assigns nothing to it. `facts`, `alive`: what the plan is made of."""
    team = workers(facts, alive)
    robots = [robot for robot in plan.idle if robot in team]
    if plan.command is not TeamOrder.RESUME:
        found = dict.fromkeys(robots, f"the operator's command is {plan.command}")
    elif plan.ended is not None:
        found = dict.fromkeys(robots, "the mission has ended")
    else:
        found = _why_free(plan, robots)
        if plan.ahead is not None:
            found |= _what_is_next(plan.ahead, found, plan.demands)
        found |= facts.idle(found)
    outside = (robot for robot in plan.idle if robot not in team)
    return found | {robot: _why_outside(facts, alive, robot) for robot in outside}


def _why_outside(facts: TeamFacts, alive: Mapping[str, Incarnation], robot: str) -> str:
    """Why the plan may not use a robot that is alive."""
    known = facts.members.get(robot)
    is_described = known is not None and known.incarnation == alive.get(robot)
    return "leaving" if is_described else "what it can do is not known yet"


def _why_free(plan: Plan, robots: Sequence[str]) -> dict[str, str]:
    demands = plan.demands
    if not demands:
        return dict.fromkeys(robots, "nothing is requested")
    waiting = {each.activation: each for each in plan.waiting}
    waits = [waiting.get(group[0].request.activation) for group in demands]
    reasons = {}
    for robot, found in _able_requests(robots, demands).items():
        served = [index for index in found if index in plan.kept]
        postponed = [each for index in served if (each := waits[index]) and each.awaited]
        names = ", ".join(sorted({demands[index][0].request.subject for index in served or found}))
        if not found:
            reasons[robot] = "nothing it can do is needed now"
        elif postponed:
            names = ", ".join(sorted({each.global_task for each in postponed}))
            reasons[robot] = f"{names}: waits for {postponed[0].awaited_things}"
        elif served:
            reasons[robot] = f"{names}: enough robots are on it"
        else:
            held = [each.held_by for index in found if (each := waits[index]) and each.held_by]
            reasons[robot] = f"{names}: {held[0] if held else 'waits for robots'}"
    return reasons


def _what_is_next(
    ahead: Lookahead, idle: Collection[str], demands: Sequence[Group]
) -> dict[str, str]:
    """For robots that the schedule in force has on something later: what, and with whom. For those
    that it has nothing for: what they could do.
    """
    found = {}
    if ahead.schedule is not None:
        scheduled = [group for group in demands if ahead.step_of(group[0].request.activation)]
        others = [robot for robot in ahead.robots if robot in idle]
        for robot, indices in _able_requests(others, scheduled).items():
            if indices:
                names = sorted({scheduled[index][0].request.subject for index in indices})
                found[robot] = f"{', '.join(names)}: the schedule has other robots for it"
    for robot, step in ahead.next_steps.items():
        if robot in idle:
            partners = ", ".join(each for each in ahead.members(step) if each != robot)
            what = ahead.opens[step.task].request.subject
            found[robot] = f"next in the schedule: {what}" + (
                f" with {partners}" if partners else ""
            )
    return found


def _able_requests(robots: Sequence[str], demands: Sequence[Group]) -> dict[str, list[int]]:
    """Robot -> the requests that it could help with, in tree order."""
    found: dict[str, list[int]] = {robot: [] for robot in robots}
    for index, group in enumerate(demands):
        for demand in group:
            for robot in found.keys() & demand.candidates.keys():
                found[robot].append(index)
    return found
