"""Making a plan: evaluate T_G, check consistency, assign robots.

A plan follows from the facts and the alive set alone, to the same bytes on every robot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeAlias

from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.problem import SideConstraint, Solver
from mrbt_mesh.core.assignment.solve import optimum, within
from mrbt_mesh.core.bt.evaluation import Evaluation, Request
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import TeamOrder
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.feature import Offer
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker, capabilities_of
from mrbt_mesh.core.planning.consistency import (
    LimitCheck,
    feasibility,
    kept_requests,
    shortages,
)
from mrbt_mesh.core.planning.demands import (
    Demand,
    Group,
    demands_of,
    incarnations,
    running_on,
)
from mrbt_mesh.core.planning.pending_failures import pending_failures
from mrbt_mesh.core.planning.plan import Plan, RobotAssignment, Waiting
from mrbt_mesh.core.planning.schedules import Lookahead, by_schedule, look_ahead

PlanFunction: TypeAlias = Callable[[TeamFacts, Mapping[str, Incarnation]], Plan]
# Makes the function that makes the plans of one robot.
PlanMaking: TypeAlias = Callable[[Solver], PlanFunction]


@dataclass(frozen=True, slots=True)
class ConsistentRequests:
    """What *Check Consistency* finds: which requests of T_G can be served together.

    `is_at_rest`: no robot is to work at all, whatever T_G asks for. `demands`: those of the
    requests. `offers`: what features make of them, the last one's demands being these. `ahead`:
    what schedules are made for, if the mission travels. `unset`: why requests wait for the
    blackboard. `offered`: the demands with the robots that may be assigned to them. `kept`: indices
    of the requests that are served. `pinned`: robots at work that go on -> index of their request.
    """

    evaluation: Evaluation
    command: TeamOrder
    ended: Status | None
    capabilities: Capabilities
    is_at_rest: bool
    demands: Sequence[Group] = ()
    offers: Sequence[Offer] = ()
    ahead: Lookahead | None = None
    obstacles: Mapping[int, str] = field(default_factory=dict)
    unset: Mapping[int, str] = field(default_factory=dict)
    offered: Sequence[Group] = ()
    kept: Sequence[int] = ()
    pinned: Mapping[str, int] = field(default_factory=dict)

    @property
    def is_consistent(self) -> bool:
        """Whether there are no requests, or some can be served."""
        return bool(self.kept or self.is_at_rest or not self.evaluation.requests)


def make_plan(
    facts: TeamFacts,
    alive: Mapping[str, Incarnation],
    solver: Solver,
    capabilities: Capabilities | None = None,
) -> Plan:
    """The plan of the mission's team for these facts, with these robots alive.

    `capabilities`: those of the robots that the plan may use, where they are known already.
    """
    capabilities = capabilities or capabilities_of(facts, alive)
    return assign_agents(facts, alive, check_consistency(facts, alive, capabilities), solver)


def plain_plans(solver: Solver) -> PlanFunction:
    """Each plan from its facts alone."""

    def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        return make_plan(facts, alive, solver)

    return plan


def quick_plans(solver: Solver) -> PlanFunction:
    """The same plans: what robots can do is looked up for those alone that differ."""
    known: Capabilities | None = None

    def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        nonlocal known
        known = capabilities = capabilities_of(facts, alive, known)
        return make_plan(facts, alive, solver, capabilities)

    return plan


def check_consistency(
    facts: TeamFacts, alive: Mapping[str, Incarnation], capabilities: Capabilities
) -> ConsistentRequests:
    """T_A, *Check Consistency*: evaluate T_G and keep the requests that can be served together."""
    mission, command, ended = facts.mission, facts.order(), facts.result(alive)
    evaluation = mission.evaluator.evaluate(facts)
    if _is_at_rest(command, ended):
        return ConsistentRequests(evaluation, command, ended, capabilities, is_at_rest=True)
    requests, team = evaluation.requests, capabilities.team
    demands = demands_of(facts, requests, capabilities)
    offered: Sequence[Group] = demands
    offers: list[Offer] = []
    for step in mission.plan_steps:
        offers.append(step.offer(facts, offered, team))
        offered = offers[-1].groups
    changed = offered
    obstacles, unset = _obstacles(facts, requests, changed, team)
    ahead = None
    if mission.travel is not None:
        ahead = look_ahead(facts, evaluation, demands, capabilities)
        offered = by_schedule(mission, ahead, offered)
    kept, pinned = kept_requests(
        facts,
        offered,
        lambda: feasibility(mission.limits, team, offered, capabilities.masks),
        obstacles | unset,
    )
    found = changed, offers, ahead, obstacles, unset, offered, kept, pinned
    return ConsistentRequests(evaluation, command, ended, capabilities, False, *found)


def assign_agents(
    facts: TeamFacts,
    alive: Mapping[str, Incarnation],
    found: ConsistentRequests,
    solver: Solver,
) -> Plan:
    """T_A, *Assign Agents*: robots at work go on, the others are put on the requests kept."""
    mission, evaluation, capabilities = facts.mission, found.evaluation, found.capabilities
    team, command = capabilities.team, found.command
    outside = [robot for robot in sorted(alive) if robot not in team]
    if found.is_at_rest:
        number, idle = facts.in_force.number, (*team, *outside)
        return Plan(evaluation, command, {}, idle, (), ended=found.ended, mission_number=number)

    demands, offered, kept, pinned = found.demands, found.offered, found.kept, found.pinned
    at_work = running_on(offered, pinned)
    assignments = {robot: _assignment(robot, demand, True) for robot, demand in at_work.items()}
    assigned = None
    if found.is_consistent:
        groups = [offered[index] for index in kept]
        assigned = _assign(mission, groups, facts.by_share(team), at_work, solver)
        assignments |= assigned or {}

    # The requests that wait, and why.
    requests, obstacles = evaluation.requests, found.obstacles
    held = _postponed(found, assignments)
    later = {requests[index].activation for index in held}
    assignments = {
        robot: assignments[robot]
        for robot in sorted(assignments)
        if assignments[robot].activation not in later
    }
    served = frozenset(kept)
    rest = [index for index in range(len(requests)) if index not in served or index in held]
    waiting = {
        i: _waiting(facts, demands[i], capabilities, obstacles.get(i, ""), held.get(i))
        for i in rest
    }
    for index, text in found.unset.items():
        waiting[index] = replace(waiting[index], held_by=text)
    if mission.limits is not None:
        check = mission.limits.check(list(team), offered)
        waiting = {
            index: _limited(each, check, demands[index], kept, index, pinned)
            for index, each in waiting.items()
        }
    pending = {}
    if waiting or mission.has_paper_policy:
        pending = pending_failures(facts, requests, waiting, obstacles, team)
    for index in sorted(pending.keys() & waiting.keys()):
        waiting[index] = replace(waiting[index], is_failing=True)
    free = [robot for robot in team if robot not in assignments]
    return Plan(
        evaluation,
        command,
        _completed(facts, assignments, team, found.ahead),
        (*free, *outside),
        tuple(waiting.values()),
        found.is_consistent,
        assigned is not None,
        {each.part.name: each.part for each in found.offers if each.part is not None},
        demands,
        tuple(pending.values()),
        tuple(loss for step in mission.plan_steps for loss in step.losses(facts, team)),
        mission_number=facts.in_force.number,
        ahead=found.ahead,
        kept=served,
    )


class Postponed(NamedTuple):
    """Why a request that could be served gets nobody yet: it awaits `things` of `robots`."""

    things: str
    robots: tuple[str, ...]


def _postponed(
    found: ConsistentRequests, assignments: Mapping[str, RobotAssignment]
) -> dict[int, Postponed]:
    """The kept requests that features postpone."""
    return {
        index: Postponed(offer.awaited_things, robots)
        for offer in found.offers
        for index, robots in offer.postponed(found.kept, assignments).items()
    }


def _is_at_rest(command: TeamOrder, ended: Status | None) -> bool:
    """Whether no robot is to work, whatever T_G asks for."""
    return command is not TeamOrder.RESUME or ended is not None


def _obstacles(
    facts: TeamFacts,
    requests: Sequence[Request],
    demands: Sequence[Group],
    team: Mapping[str, Worker],
) -> tuple[dict[int, str], dict[int, str]]:
    """Why requests cannot be served, whichever robots are free, and why they wait for values."""
    found, unset = {}, {}
    for index, request in enumerate(requests):
        task = facts.mission.global_tasks[request.subject]
        joint = task.joint
        if joint is not None and (text := joint.obstacle(facts, request, demands[index], team)):
            found[index] = text
        if task.reads:
            values = facts.values_read(request.activation, task)
            names = [name for name, value in zip(task.reads, values, strict=True) if value is None]
            if names:
                unset[index] = f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} not set"
    return found, unset


def _assign(
    mission: Mission,
    groups: Sequence[Group],
    team: Sequence[str],
    at_work: Mapping[str, Demand],
    solver: Solver,
) -> dict[str, RobotAssignment] | None:
    """Put robots that are not at work on what the kept demands still ask for; None: infeasible.

    `team`: its robots in the order in which the canonical optimum asks them.
    """
    wanted: dict[str, Demand] = {}
    named: list[NamedDemand] = []
    for group in groups:
        for demand in group:
            activation = demand.request.activation
            held = sum(
                r in at_work and at_work[r].request.activation == activation for r in demand.pinned
            )
            if demand.upper > held:
                name = f"{activation}/{demand.local_task}"
                lower, upper = max(0, demand.lower - held), demand.upper - held
                named.append(NamedDemand(name, lower, upper, demand.candidates))
                wanted[name] = demand
    if not wanted:
        return {}
    free = tuple(robot for robot in team if robot not in at_work)
    problem = NamedProblem(free, tuple(named))
    limited: tuple[SideConstraint, ...] = ()
    if mission.limits is not None:
        limited = mission.limits.side_constraints(free, list(wanted.values()), at_work)
    if limited:
        assigned = within(problem, limited, solver)
    else:
        assigned = optimum(problem, solver, mission.may_need_arrays)
    if assigned is None:
        return None
    return {robot: _assignment(robot, wanted[name], False) for robot, name in assigned.items()}


def _assignment(robot: str, demand: Demand, pinned: bool) -> RobotAssignment:
    request, performance = demand.request, demand.candidates[robot]
    where = request.activation, request.subject, demand.local_task
    return RobotAssignment(robot, *where, performance, pinned)


def _waiting(
    facts: TeamFacts,
    group: Group,
    capabilities: Capabilities,
    obstacle: str,
    postponed: Postponed | None,
) -> Waiting:
    """Why a request is not served."""
    short = () if obstacle or postponed else shortages(facts, group, capabilities)
    request = group[0].request
    things, awaited = postponed or ("", ())
    names = request.activation, request.subject
    return Waiting(*names, short, obstacle, awaited=awaited, awaited_things=things)


def _limited(
    waiting: Waiting,
    check: LimitCheck,
    group: Group,
    kept: Sequence[int],
    index: int,
    pinned: Mapping[str, int],
) -> Waiting:
    """Name the limits that a request waits for, or within which it cannot be served."""
    if waiting.is_blocked or waiting.awaited or waiting.held_by:
        return waiting
    never = check.obstacle(group)
    if never:
        return replace(waiting, obstacle=never)
    return replace(waiting, held_by=check.in_the_way(kept, index, pinned))


def _completed(
    facts: TeamFacts,
    assignments: Mapping[str, RobotAssignment],
    team: Mapping[str, Worker],
    ahead: Lookahead | None,
) -> dict[str, RobotAssignment]:
    """Name the leader where robots carry out a task jointly: that of the party at work, else the
    first robot that the schedule in force has on the activation, else that of the plan. And put in
    what a task reads from the blackboard.
    """
    leaders: dict[str, tuple[str, int]] = {}
    result = {}
    for robot, assignment in assignments.items():
        task, activation = facts.mission.global_tasks[assignment.global_task], assignment.activation
        if task.joint is not None:
            if activation not in leaders:
                lives = incarnations(team)
                leader, number = task.joint.lead(facts, task, activation, lives)
                step = ahead.step_of(activation) if ahead is not None else None
                first = ahead.members(step)[0] if ahead is not None and step else robot
                leaders[activation] = (leader or first, number)
            leader, number = leaders[activation]
            assignment = replace(assignment, leader=leader, round=number)
        if task.reads:
            read = facts.values_read(activation, task)
            values = tuple((n, v) for n, v in zip(task.reads, read, strict=True) if v is not None)
            assignment = replace(assignment, values=values)
        result[robot] = assignment
    return result
