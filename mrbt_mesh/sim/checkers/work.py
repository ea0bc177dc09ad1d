"""I4: nobody works on what it cannot do, and bounds hold. I6: what can be finished is finished."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import (
    ARGUMENTS,
    Arguments,
    Claim,
    Hold,
    Phase,
    TeamOrder,
)
from mrbt_mesh.core.facts.team_facts import capability
from mrbt_mesh.core.planning.capabilities import capabilities_of, workers
from mrbt_mesh.core.planning.consistency import feasibility
from mrbt_mesh.core.planning.demands import Group, demands_of
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.schedules import by_schedule
from mrbt_mesh.sim.checkers.barriers import lacked
from mrbt_mesh.sim.checkers.findings import RunFindings, current_plan

# Statuses of a mission that has ended.
OVER = (Status.SUCCESS, Status.FAILURE)


def not_taken_off(run: RunFindings, agent: AgentView, claim: Claim) -> None:
    """I4: no robot is taken off work that the plan still serves, if nothing is preemptive.

    `claim` is what the agent ran until now.
    """
    facts, plan, task = agent.facts, agent.plan, agent.facts.task_of(claim.activation)
    if task is None:
        return  # another revision of the mission does not have it
    job = parse_activation(claim.activation).job
    if facts.jobs is not None and facts.jobs.hold_of(job) is Hold.NOW:
        return  # operators want it to end
    if task.joint is not None or any(each.preemptive for each in facts.in_force.all_tasks()):
        return  # the members of a coalition stop together
    if plan is None or plan.command is not TeamOrder.RESUME or agent.is_joining or agent.is_leaving:
        return
    member, results = facts.members[agent.robot].member, facts.results(*_place(claim))
    if agent.robot in results or capability(member, claim.local_task) is None:
        return
    if not is_served(plan, claim.activation) or lacked(facts, claim.activation, agent.robot):
        return
    needs = task.needs
    need = next(need for need in needs if need.local_task == claim.local_task)
    room = max(need.min_robots - sum(results.values()), need.max_robots - len(results), 0)
    before = 0
    for robot in workers(facts, agent.alive()):
        other, life = facts.claims.get(robot, (None, None))
        if other is None or life != facts.members[robot].incarnation:
            continue  # of an earlier life
        if robot not in results and _place(other) == _place(claim):
            running = other.phase is Phase.RUNNING and robot != agent.robot
            before += running and (other.since, robot) < (claim.since, agent.robot)
    if before < room and keeps_pin(agent, plan, claim):
        text = f"{agent.robot} is taken off {claim.local_task} of {claim.activation}"
        run.violation("I4", f"{text}, which it runs and the plan serves")


def able_to_start(run: RunFindings, agent: AgentView, start: StartAction) -> None:
    """I4: a robot starts only what it is capable of, where its own conditions hold."""
    if capability(agent.facts.members[agent.robot].member, start.local_task) is None:
        run.violation("I4", f"{agent.robot} starts {start.local_task}, which it cannot do")
    if condition := lacked(agent.facts, start.activation, agent.robot):
        text = f"{agent.robot} starts {start.local_task}, but {condition} does not hold for it"
        run.violation("I4", text)


def _hear_in_time(run: RunFindings) -> bool:
    """Whether all robots hear one another within a part of the grace time."""
    world = run.world
    delay_us = world.network.slowest_us + 2 * world.plan_delay_us
    prompt = delay_us < world.timing.grace_us // 4
    return prompt and not world.cut_off and world.network.is_reliable_at(world.clock.now_us)


def same_arguments(run: RunFindings, agent: AgentView, start: StartAction) -> None:
    """I4: a robot begins with the arguments that are facts, and all on one activation with the same
    where they hear one another.
    """
    if not start.values:
        return
    run.checks["I4"] += 1
    name = f"{ARGUMENTS}/{start.activation}"
    *_, known = min(
        (entry.record.stamp, entry.author, entry.record.values)
        for entry in agent.facts.map
        if entry.name == name and isinstance(entry.record, Arguments)
    )
    others = {
        action.values
        for process in run.world.living()
        if process.agent is not None
        and (action := process.agent.view.action) is not None
        and action.activation == start.activation
    }
    if tuple(value for _, value in start.values) != known or (
        _hear_in_time(run) and len(others) > 1
    ):
        text = f"{agent.robot} starts {start.activation} with {dict(start.values)}"
        run.violation("I4", f"{text}, others with {sorted(others)}; known is {known}")


def at_most_mu(run: RunFindings, agent: AgentView, start: StartAction) -> None:
    """I4: where all hear one another in time, at most mu robots work on a need at any moment."""
    world, place = run.world, (start.activation, start.local_task)
    if not _hear_in_time(run):
        return
    robots = [
        process.robot
        for process in world.living()
        if process.agent is not None
        and (action := process.agent.view.action) is not None
        and not action.travel_to
        and (action.activation, action.local_task) == place
    ]
    needs = agent.facts.task(start.activation).needs
    most = next((n.max_robots for n in needs if n.local_task == start.local_task), 0)
    if len(robots) > most:
        text = f"{', '.join(robots)} are on {place[1]} of {place[0]}, at most {most} may be"
        run.violation("I4", text)


def in_its_place(run: RunFindings, agent: AgentView, start: StartAction) -> None:
    """I4: a robot begins a local task where it happens: the facts say so, and it is there."""
    travel = agent.mission.travel
    if travel is None or start.local_task not in travel.at:
        return
    run.checks["I4"] += 1
    place, known = travel.at[start.local_task], agent.facts.place_of(agent.robot)
    if known != place or not run.world.driving.is_at(agent.robot, place):
        text = f"{agent.robot} starts {start.local_task}, which is at {place}, somewhere else"
        run.violation("I4", f"{text} (the facts say {known})")


def plan_is_carried_out(run: RunFindings, agents: Sequence[AgentView]) -> None:
    """I4: at rest, everybody works on its part of the plan, and every demand is within bounds."""
    run.checks["I4"] += 1
    agent, alive = agents[0], {agent.robot: agent.incarnation for agent in agents}
    plan = current_plan(agent, run.world.solver)
    tasks, ungranted = agent.mission.global_tasks, run.may_lack_grants
    for each in agents:
        mine, claim = plan.assignments.get(each.robot), each.claim
        if mine is not None and tasks[mine.global_task].at_most_once and ungranted:
            continue
        wanted = (mine.activation, mine.local_task) if mine else None
        found = _place(claim) if claim and _is_at_work(each, plan, claim) else None
        if wanted != found:
            run.violation("I4", f"{each.robot} works on {found}, by the plan on {wanted}")
    if plan.command is not TeamOrder.RESUME or plan.result in OVER:
        return  # no request asks for robots any more
    waiting = {w.activation for w in plan.waiting}
    on = Counter((each.activation, each.local_task) for each in plan.assignments.values())
    capable = capabilities_of(agent.facts, alive)
    groups: Sequence[Group] = demands_of(agent.facts, plan.evaluation.requests, capable)
    if plan.ahead is not None:
        groups = by_schedule(agent.mission, plan.ahead, groups)
    for group in groups:
        for demand in group:
            place = (demand.request.activation, demand.local_task)
            low = 0 if place[0] in waiting else demand.lower
            if not low <= on[place] <= demand.upper:
                bounds = f"{place[0]}: {low}..{demand.upper}"
                text = f"{on[place]} robots on {demand.local_task} of {bounds}"
                run.violation("I4", text)


def _is_at_work(agent: AgentView, plan: Plan, claim: Claim) -> bool:
    """Whether a robot works, is on its way, or waits for partners that are, or that by the schedule
    first do something else.
    """
    partners = [r for r, line in plan.assignments.items() if line.activation == claim.activation]
    is_gathering = any(agent.facts.under_way(robot) for robot in partners)
    step = plan.ahead.step_of(claim.activation) if plan.ahead is not None else None
    if plan.ahead is not None and step is not None:
        later = set(plan.ahead.members(step)) - set(partners)
        next_steps = plan.ahead.next_steps
        is_gathering |= any(r in plan.assignments or next_steps[r] is not step for r in later)
    moves = claim.phase in (Phase.RUNNING, Phase.TRAVELLING)
    return moves or (claim.phase is Phase.READY and is_gathering)


def _place(claim: Claim) -> tuple[str, str]:
    return claim.activation, claim.local_task


def keeps_pin(agent: AgentView, plan: Plan, claim: Claim) -> bool:
    """Whether the claim's request can be met with all running robots left where they are.

    Otherwise pins may yield, also this one.
    """
    facts = agent.facts
    capable = capabilities_of(facts, agent.alive())
    groups = [list(group) for group in demands_of(facts, plan.evaluation.requests, capable)]
    obstacles = {waiting.activation for waiting in plan.waiting if waiting.obstacle}
    for index, group in enumerate(groups):
        for number, demand in enumerate(group):
            if (demand.request.activation, demand.local_task) == _place(claim):
                others = [robot for robot in demand.pinned if robot != agent.robot]
                groups[index][number] = replace(demand, pinned=(*others, agent.robot))
    pinned = {r: i for i, group in enumerate(groups) for d in group for r in d.pinned}
    check = feasibility(facts.mission.limits, capable.team, groups)
    return any(
        check.keep(index, group, pinned) and group[0].request.activation == claim.activation
        for index, group in enumerate(groups)
        if group[0].request.activation not in obstacles
    )


def is_served(plan: Plan, activation: str) -> bool:
    """Whether the plan keeps the request of this activation."""
    requested = any(request.activation == activation for request in plan.evaluation.requests)
    return requested and all(waiting.activation != activation for waiting in plan.waiting)
