"""Making plans: evaluate T_G, check consistency, assign robots.

A plan follows from the facts and the alive set alone. `PlanMaker` also remembers what it has
worked out for the plan before, and uses that where nothing has changed: the plans are the same.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from mrbt_mesh.core.assignment import SideConstraint, Solver
from mrbt_mesh.core.bidding import Biddings
from mrbt_mesh.core.canonical import solve
from mrbt_mesh.core.capable import Capable, Worker
from mrbt_mesh.core.coalition import standing
from mrbt_mesh.core.consistency import ConsistencyKeeper, kept_one_by_one, shortages
from mrbt_mesh.core.constraints import Constraint
from mrbt_mesh.core.demand import Demand, Demands, lives, obstacle
from mrbt_mesh.core.evaluate import Evaluator, Request
from mrbt_mesh.core.facts import Incarnation
from mrbt_mesh.core.limits import Limits, running_on, side_constraints
from mrbt_mesh.core.mission import Assignment
from mrbt_mesh.core.offers import Offered, Team
from mrbt_mesh.core.plan import Line, Plan, Waiting
from mrbt_mesh.core.reassign import Reassigner
from mrbt_mesh.core.records import OrderKind
from mrbt_mesh.core.scarcity import spare_scarce
from mrbt_mesh.core.scratch import named, optimum
from mrbt_mesh.core.team import TeamFacts

Group = tuple[Demand, ...]


def make_plan(
    evaluator: Evaluator, facts: TeamFacts, alive: Mapping[str, Incarnation], solver: Solver
) -> Plan:
    """The plan for these facts and this alive set, from scratch."""
    return PlanMaker(evaluator, solver).plan(facts, alive)


@dataclass(frozen=True, slots=True)
class _Open:
    """A demand that still takes robots, beside the `held` ones that are pinned to it."""

    demand: Demand
    held: int
    offered: Offered


class PlanMaker:
    """Makes one plan after the other, for one tree."""

    def __init__(self, evaluator: Evaluator, solver: Solver) -> None:
        self.evaluator = evaluator
        self._capable = Capable()
        self._demands = Demands()
        self._consistency = ConsistencyKeeper()
        self._biddings = Biddings()
        self._waiting: dict[str, tuple[Group, Waiting]] = {}
        self._open: dict[str, _Open] = {}
        self._solver = solver
        self._reassigner = Reassigner(partial(optimum, solver=solver))
        self._lines: dict[tuple[str, bool], tuple[Demand, Line]] = {}

    def plan(self, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        """The plan for these facts and this alive set."""
        evaluation = self.evaluator.evaluate(facts)
        order = facts.order()
        team = self._capable.follow(facts, alive)
        away = {robot: "leaving" for robot in sorted(alive) if robot not in team}
        if order is not OrderKind.RESUME:
            idle = dict.fromkeys(team, f"the operator's order is {order}")
            return Plan(evaluation, order, {}, idle | away, (), True)
        requests = evaluation.requests
        groups = self._demands.groups(facts, requests, self._capable)
        demands, biddings = self._biddings.follow(facts, groups, team)
        obstacles = self._obstacles(facts, requests, demands)
        offered = demands
        if facts.mission.assignment is Assignment.SPARE_SCARCE:
            offered = spare_scarce(facts, evaluation, demands, team)
        constraints, robots = facts.mission.constraints, list(team)
        if constraints:
            kept, pinned = kept_one_by_one(
                facts, offered, lambda: Limits(constraints, robots, offered), obstacles
            )
        else:
            kept, pinned = self._consistency.kept_requests(facts, offered, team, obstacles)
        holders = self._pinned_lines(offered, pinned)
        running = running_on(offered, pinned) if constraints else {}
        chosen = self._assign([offered[i] for i in kept], team, holders, constraints, running)
        lines = holders if chosen is None else holders | chosen
        served = frozenset(kept)
        held = self._biddings.held_back(demands, kept, lines)
        if held:
            later = {requests[index].activation for index in held}
            lines = {robot: x for robot, x in lines.items() if x.activation not in later}
        rest = [i for i in range(len(requests)) if i not in served or i in held]
        waiting = self._wait(
            facts, [(demands[i], obstacles.get(i, ""), held.get(i, ())) for i in rest]
        )
        if constraints:
            limits = Limits(constraints, robots, offered)
            waiting = tuple(
                each
                if each.is_blocked or each.awaited
                else _limited(each, limits, demands[i], kept, i, pinned)
                for i, each in zip(rest, waiting, strict=True)
            )
        idle = _why_idle([r for r in team if r not in lines], demands, offered, served, held)
        ordered = _with_leaders(facts, {robot: lines[robot] for robot in sorted(lines)}, team)
        feasible = chosen is not None
        return Plan(evaluation, order, ordered, idle | away, waiting, feasible, biddings)

    def _obstacles(
        self, facts: TeamFacts, requests: Sequence[Request], demands: Sequence[Group]
    ) -> dict[int, str]:
        """What is in the way of requests, whoever is free."""
        tasks = facts.mission.global_tasks
        found = {
            index: obstacle(facts, request, demands[index], self._capable.team)
            for index, request in enumerate(requests)
            if tasks[request.subject].exclusive
        }
        return {index: text for index, text in found.items() if text}

    def _line(self, robot: str, demand: Demand, pinned: bool) -> Line:
        known = self._lines.get((robot, pinned))
        if known is None or known[0] is not demand:
            request = demand.request
            line = Line(
                robot,
                request.activation,
                request.subject,
                demand.local_task,
                demand.candidates[robot],
                pinned,
            )
            known = self._lines[robot, pinned] = demand, line
        return known[1]

    def _pinned_lines(self, demands: Sequence[Group], pinned: Mapping[str, int]) -> dict[str, Line]:
        return {
            robot: self._line(robot, demand, True)
            for index, group in enumerate(demands)
            for demand in group
            for robot in demand.pinned
            if pinned.get(robot) == index
        }

    def _assign(
        self,
        groups: Sequence[Group],
        team: Mapping[str, Worker],
        pinned: Mapping[str, Line],
        constraints: Sequence[Constraint],
        running: Mapping[str, Demand],
    ) -> dict[str, Line] | None:
        """Put robots that are not pinned on what the kept demands still want; None: infeasible."""
        wanted = self._open_demands(groups, pinned)
        if not wanted:
            return {}
        free = tuple(robot for robot in team if robot not in pinned)
        problem = Team(free, tuple(each.offered for each in wanted))
        limits = side_constraints(constraints, free, [each.demand for each in wanted], running)
        assigned = self._within(problem, limits) if limits else self._reassigner.update(problem)
        if assigned is None:
            return None
        demands = {each.offered.id: each.demand for each in wanted}
        return {
            robot: self._line(robot, demands[demand], False) for robot, demand in assigned.items()
        }

    def _within(self, team: Team, limits: tuple[SideConstraint, ...]) -> Mapping[str, str] | None:
        """Robot -> demand within side constraints, from scratch; None if infeasible."""
        problem = replace(team.problem(), constraints=limits)
        return named(team, solve(problem, self._solver))

    def _open_demands(self, groups: Sequence[Group], pinned: Mapping[str, Line]) -> list[_Open]:
        """What the kept demands still want, beside the robots that are pinned to them."""
        before, self._open = self._open, {}
        found = []
        for group in groups:
            for demand in group:
                activation = demand.request.activation
                held = sum(
                    robot in pinned and pinned[robot].activation == activation
                    for robot in demand.pinned
                )
                if demand.upper <= held:
                    continue
                key = f"{activation}/{demand.local_task}"
                known = before.get(key)
                if known is None or known.demand is not demand or known.held != held:
                    lower, upper = max(0, demand.lower - held), demand.upper - held
                    known = _Open(demand, held, Offered(key, lower, upper, demand.candidates))
                self._open[key] = known
                found.append(known)
        return found

    def _wait(
        self, facts: TeamFacts, rest: Sequence[tuple[Group, str, tuple[str, ...]]]
    ) -> tuple[Waiting, ...]:
        """Why the requests that are not served wait, in tree order."""
        before, self._waiting = self._waiting, {}
        found = []
        for group, text, awaited in rest:
            request = group[0].request
            known = before.get(request.activation)
            if (
                known is None
                or known[0] is not group
                or (known[1].obstacle, known[1].awaited) != (text, awaited)
            ):
                short = () if text or awaited else shortages(facts, group, self._capable)
                activation, subject = request.activation, request.subject
                known = group, Waiting(activation, subject, short, text, awaited=awaited)
            self._waiting[request.activation] = known
            found.append(known[1])
        return tuple(found)


def _limited(
    waiting: Waiting,
    limits: Limits,
    group: Group,
    kept: Sequence[int],
    index: int,
    pinned: Mapping[str, int],
) -> Waiting:
    """Name the side constraints that a request waits for, or that it cannot be served within."""
    never = limits.obstacle(group)
    if never:
        return replace(waiting, obstacle=never)
    return replace(waiting, held_by=limits.in_the_way(kept, index, pinned))


def _with_leaders(
    facts: TeamFacts, lines: Mapping[str, Line], team: Mapping[str, Worker]
) -> dict[str, Line]:
    """Name the leader where a task is carried out by a coalition: that of the standing one,
    else the first robot that the plan has on the activation.
    """
    leaders: dict[str, tuple[str, int]] = {}
    result = {}
    for robot, line in lines.items():
        task = facts.mission.global_tasks[line.global_task]
        if task.by_coalition:
            if line.activation not in leaders:
                token = standing(facts, task, line.activation, lives(team))
                number = facts.coalitions(line.activation).round(facts.givers, token)
                leaders[line.activation] = (token.leader if token is not None else robot, number)
            leader, number = leaders[line.activation]
            line = replace(line, leader=leader, round=number)
        result[robot] = line
    return result


def _why_idle(
    robots: Sequence[str],
    demands: Sequence[Group],
    offered: Sequence[Group],
    kept: Collection[int],
    held: Collection[int],
) -> dict[str, str]:
    """For robots without a line: why."""
    if not demands:
        return dict.fromkeys(robots, "nothing is requested")
    able, spared = _able_requests(robots, demands), set(robots)
    if offered is demands:
        spared.clear()
    else:
        spared -= {robot for robot, found in _able_requests(robots, offered).items() if found}
    reasons = {}
    for robot, found in able.items():
        served = [index for index in found if index in kept]
        names = sorted({demands[index][0].request.subject for index in served or found})
        if not found:
            reasons[robot] = "no request needs what it can do"
        elif robot in spared:
            names = sorted({demands[index][0].request.subject for index in found})
            reasons[robot] = f"{', '.join(names)}: spared for what fewer robots can do"
        elif waiting := [index for index in served if index in held]:
            names = sorted({demands[index][0].request.subject for index in waiting})
            reasons[robot] = f"{', '.join(names)}: waits for bids"
        elif served:
            reasons[robot] = f"{', '.join(names)}: as many robots as are allowed or useful"
        else:
            reasons[robot] = f"{', '.join(names)}: waits for robots"
    return reasons


def _able_requests(robots: Sequence[str], demands: Sequence[Group]) -> dict[str, list[int]]:
    """Robot -> the requests that it could help with, in tree order."""
    found: dict[str, list[int]] = {robot: [] for robot in robots}
    for index, group in enumerate(demands):
        for demand in group:
            for robot in found.keys() & demand.candidates.keys():
                found[robot].append(index)
    return found
