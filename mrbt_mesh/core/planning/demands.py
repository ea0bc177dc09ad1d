"""Demands: what the requests of T_G ask of the team.

Source: paper, section V, T_A: the bounds a_j and b_j.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import TypeAlias

from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts.records import Hold, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Need, SameRobotAs
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker


@dataclass(frozen=True, slots=True)
class Demand:
    """One local task of one request.

    `lower` and `upper` are a_j and b_j, shrunk by the outcomes so far. `pinned` robots are
    already running it (or about to start, with others that are) and count towards both.
    `candidates` map robot to performance for all workers that could be put on it: capable and
    without an outcome for it. `after`: only those that have done something before, or for which
    something holds, and what.
    """

    request: Request
    local_task: str
    needed: int
    lower: int
    upper: int
    pinned: tuple[str, ...]
    candidates: Mapping[str, int]
    after: str = ""


Group: TypeAlias = tuple[Demand, ...]


def demands_of(
    facts: TeamFacts, requests: Sequence[Request], capabilities: Capabilities
) -> list[Group]:
    """The demands of each request, in tree order and the task's order of needs.

    lower = nu - successes, upper = mu - successes - failures (never below lower). Once successes
    reach nu, no further robot is assigned; where nu is 0, robots may help up to the end. At most mu
    running claims are pinned, in the canonical order of claims: (since, robot). Of a job that is
    held only what runs goes on, and that neither if operators want it to end now.
    """
    running = running_claims(facts, capabilities.team)
    groups = [
        request_demands(facts, request, capabilities, running.get(request.activation, {}))
        for request in requests
    ]
    if facts.jobs is None:
        return groups
    nodes, jobs = facts.mission.tree.nodes, facts.jobs
    holds = (jobs.hold_of(nodes[request.node].job) for request in requests)
    return [_held(group, hold) for group, hold in zip(groups, holds, strict=True)]


def _held(group: Group, hold: Hold) -> Group:
    if hold is Hold.RELEASED:
        return group
    left = []
    for demand in group:
        pinned = () if hold is Hold.NOW else demand.pinned
        count, candidates = len(pinned), {robot: demand.candidates[robot] for robot in pinned}
        left.append(replace(demand, lower=count, upper=count, pinned=pinned, candidates=candidates))
    return tuple(left)


def running_claims(
    facts: TeamFacts, team: Mapping[str, Worker]
) -> dict[str, dict[str, tuple[str, ...]]]:
    """Activation -> local task -> robots at work on it, in the canonical order of claims."""
    found: dict[str, dict[str, tuple[str, ...]]] = {}
    claims = [(robot, facts.valid_claim(robot)) for robot in team]
    running = [(c.since, robot, c) for robot, c in claims if c and c.phase is Phase.RUNNING]
    for _, robot, claim in sorted(running, key=itemgetter(0, 1)):
        robots = found.setdefault(claim.activation, {})
        robots[claim.local_task] = (*robots.get(claim.local_task, ()), robot)
    return found


def running_on(demands: Sequence[Sequence[Demand]], pinned: Mapping[str, int]) -> dict[str, Demand]:
    """Robot -> the demand that it works on; `pinned` maps robots to requests."""
    return {
        robot: demand
        for index, group in enumerate(demands)
        for demand in group
        for robot in demand.pinned
        if pinned.get(robot) == index
    }


def done_before(facts: TeamFacts, request: Request, before: SameRobotAs) -> tuple[str, ...]:
    """The robots with the success that `same_robot_as` asks for.

    It counts in the present activation of the nearest action before the request, in tree order,
    and of the same job if the request is of one, of which any success is known.
    """
    names = facts.mission.evaluator
    nodes = facts.mission.tree.nodes
    for node in range(request.node - 1, -1, -1):
        is_of_job = nodes[node].job == nodes[request.node].job
        if (
            is_of_job
            and nodes[node].kind is Kind.ACTION
            and nodes[node].subject == before.global_task
        ):
            activation = str(names.current_activation(node, facts))
            results = facts.results(activation, before.local_task)
            robots = sorted(robot for robot, success in results.items() if success)
            if robots:
                return tuple(robots)
    return ()


def request_demands(
    facts: TeamFacts,
    request: Request,
    capabilities: Capabilities,
    running: Mapping[str, tuple[str, ...]],
    is_restricted: bool = True,
) -> Group:
    """The demands of one request; `running`: its local tasks -> robots at work on them.

    `is_restricted`: of capable robots only those are candidates that did what `same_robot_as` asks
    for, and for which the per-robot conditions among the request's guards hold.
    """
    mission = facts.mission
    task, asked = mission.global_tasks[request.subject], ""
    own: Sequence[str] | None = None
    for step in mission.plan_steps:
        asked += step.asked_for(facts, request)
        those = step.eligible(facts, request) if is_restricted else None
        if those is not None:
            own = those if own is None else [robot for robot in own if robot in those]
    able: list[Mapping[str, int]] = []
    for need in task.needs:
        found = capabilities.able(need.local_task)
        if is_restricted and need.same_robot_as is not None:
            did = done_before(facts, request, need.same_robot_as)
            found = {robot: found[robot] for robot in did if robot in found}
        if own is not None:
            found = {robot: found[robot] for robot in own if robot in found}
        able.append(found)
    if task.joint is not None:
        return task.joint.demands(facts, request, capabilities, able, asked)
    ends = facts.outcomes(request.activation)
    return tuple(
        _demand(request, need, found, ends, running, asked)
        for need, found in zip(task.needs, able, strict=True)
    )


def _demand(
    request: Request,
    need: Need,
    able: Mapping[str, int],
    ends: Mapping[str, Mapping[str, bool]],
    running: Mapping[str, tuple[str, ...]],
    asked: str,
) -> Demand:
    results = ends.get(need.local_task, {})
    successes = sum(results.values())
    lower = max(0, need.min_robots - successes)
    upper = max(lower, need.max_robots - len(results), 0)
    candidates = able
    if results:
        candidates = {robot: value for robot, value in able.items() if robot not in results}
    runners = running.get(need.local_task, ())
    pinned = tuple(robot for robot in runners if robot in candidates)[:upper]
    if not lower and need.min_robots:
        upper = len(pinned)
    bounds = need.min_robots, lower, upper
    return Demand(request, need.local_task, *bounds, pinned, candidates, need.after + asked)


def incarnations(team: Mapping[str, Worker]) -> dict[str, Incarnation]:
    """Robot -> incarnation."""
    return {robot: worker.incarnation for robot, worker in team.items()}
