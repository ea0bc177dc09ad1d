"""The demands of tasks that coalitions carry out, and what keeps exclusive ones waiting."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Recorded, majority
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker
from mrbt_mesh.core.planning.demands import Demand, Group, incarnations
from mrbt_mesh.core.planning.plan import UNDECIDED, Waiting
from mrbt_mesh.features.exclusive.coalitions import (
    Coalitions,
    coalition_at_work,
    coalitions_of,
    grantors,
    is_still_in,
)
from mrbt_mesh.features.exclusive.fields import CoalitionFields, InDoubtPolicy, in_doubt_policy
from mrbt_mesh.features.exclusive.records import CoalitionId

JOURNALS = " whose journals can be written"
RECORDINGS = " that record"
# How it begins that an exclusive request lacks robots that may grant it.
LACKS_GRANTS = "exclusive: needs grants from"


def demands(
    facts: TeamFacts,
    request: Request,
    policy: CoalitionFields,
    capabilities: Capabilities,
    able: Sequence[Mapping[str, int]],
    asked: str,
) -> Group:
    """A coalition that has started goes on, and no robot joins it; before, the bounds are nu, mu.

    Only robots whose journals can be written begin an exclusive task, and only those that record
    it if the mission requires that.
    """
    task = facts.mission.global_tasks[request.subject]
    team, found = capabilities.team, coalitions_of(facts, request.activation)
    token = coalition_at_work(facts, task, request.activation, incarnations(team))
    at_work = _at_work(facts, request, found, token, team) if token is not None else {}
    result = []
    for need, those in zip(task.needs, able, strict=True):
        failed = found.failed_robots(need.local_task)
        candidates = {robot: value for robot, value in those.items() if robot not in failed}
        lower, upper = need.min_robots, need.max_robots
        pinned: tuple[str, ...] = ()
        after = need.after + asked
        if token is None and policy.exclusive:
            found_able = len(candidates)
            candidates = {r: v for r, v in candidates.items() if team[r].member.may_promise}
            after += JOURNALS if len(candidates) < found_able else ""
            if facts.mission.recorded is Recorded.REQUIRED:
                found_able = len(candidates)
                candidates = {r: v for r, v in candidates.items() if facts.is_recorded(r)}
                after += RECORDINGS if len(candidates) < found_able else ""
        if token is not None:
            pinned = tuple(r for r in candidates if at_work.get(r) == need.local_task)
            lower = upper = len(pinned)
        bounds = need.min_robots, lower, upper
        demand = Demand(request, need.local_task, *bounds, pinned, candidates, after)
        result.append(demand)
    return tuple(result)


def _at_work(
    facts: TeamFacts,
    request: Request,
    found: Coalitions,
    token: CoalitionId,
    team: Mapping[str, Worker],
) -> dict[str, str]:
    """Robot -> local task, for the members of a coalition that have not finished."""
    return {
        member.robot: member.local_task
        for member in found.members[token]
        if member.robot in team
        and team[member.robot].incarnation == (member.counter, member.nonce)
        and found.outcome(token, member) is None
        and is_still_in(facts, token, member, request.activation)
    }


def obstacle(
    facts: TeamFacts,
    request: Request,
    policy: CoalitionFields,
    group: Group,
    team: Mapping[str, Worker],
) -> str:
    """Why an exclusive request cannot be served, whichever robots are free; empty if it can."""
    task = facts.mission.global_tasks[request.subject]
    named = grantors(facts)
    doubted = coalitions_of(facts, request.activation).in_doubt(named)
    if doubted and policy.in_doubt is not InDoubtPolicy.RETRY:
        names = ", ".join(sorted({token.leader for token in doubted}))
        return f"{UNDECIDED}: nobody knows how far {names} got; `mrbt decide` says how it goes on"
    token = coalition_at_work(facts, task, request.activation, incarnations(team))
    if token is not None:
        if any(demand.pinned for demand in group):
            return ""
        return f"{token.leader} is out of reach and may still be at it"
    may_grant = [worker.member.may_promise for r, worker in team.items() if r in named]
    needed, present = majority(named), sum(may_grant)
    if present < needed:
        which = JOURNALS if present < len(may_grant) else ""
        return f"{LACKS_GRANTS} {needed} of {len(named)} robots{which}, {present} here"
    return ""


def would_help(
    facts: TeamFacts, waiting: Waiting, here: Collection[str]
) -> tuple[Collection[str], int]:
    """Which robots could be started so that a majority can grant an exclusive request."""
    if not waiting.obstacle.startswith(LACKS_GRANTS):
        return (), 0
    named = grantors(facts)
    present = [r for r in here if r in named and r in facts.members]
    granting = sum(facts.members[robot].member.may_promise for robot in present)
    return named, majority(named) - granting


def awaits_operator(facts: TeamFacts, request: Request) -> bool:
    """Whether a request was granted and is held in doubt, or will be."""
    task = facts.mission.global_tasks[request.subject]
    is_held = in_doubt_policy(task) is InDoubtPolicy.HOLD
    return task.at_most_once and is_held and bool(coalitions_of(facts, request.activation).grants)
