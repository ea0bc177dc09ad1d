"""*Assign Agents* from scratch: robot -> demand, in the way that is fastest for a team's size.

All of them lead to the canonical optimum (`canonical`). One demand has its best robots. For few
robots and demands it is not worth while to load arrays, and solvers that need them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mrbt_mesh.core.assignment.named import NamedProblem
from mrbt_mesh.core.assignment.problem import (
    UNASSIGNED,
    SideConstraint,
    Solver,
    require_planner,
)
from mrbt_mesh.core.assignment.solvers import default_solver

# Robots times demands up to which `of_few` takes less than 3 ms. From some 100 on arrays would be
# faster, by 2 ms at most; but loading them takes 200 ms and 30 MB in every robot of a small team.
FEW = 300


def needs_arrays(robots: int, demands: int) -> bool:
    """Whether arrays are the faster way for this size, and not `of_few`."""
    return demands > 1 and robots * demands > FEW


def optimum(
    team: NamedProblem, solver: Solver, may_use_arrays: bool = True
) -> dict[str, str] | None:
    """Robot -> demand, without the idle robots; None if infeasible.

    A solver of the user's is asked whenever there is a choice between demands. Without
    `may_use_arrays` the default one never is: robots that lack its libraries plan the mission as
    well. Raises SolverError as `canonical.solve`.
    """
    if len(team.demands) == 1:
        return of_one(team)
    is_large = may_use_arrays and needs_arrays(len(team.robots), len(team.demands))
    if solver is default_solver and not is_large:
        return of_few(team)
    # Loaded here: the libraries make up a third of a robot's process.
    require_planner()
    from mrbt_mesh.core.assignment.canonical import solve

    return named(team, solve(team.problem(), solver))


def within(
    problem: NamedProblem, limits: tuple[SideConstraint, ...], solver: Solver
) -> dict[str, str] | None:
    """`optimum` within side constraints."""
    require_planner()
    from mrbt_mesh.core.assignment.canonical import solve

    return named(problem, solve(replace(problem.problem(), constraints=limits), solver))


def named(team: NamedProblem, choice: Sequence[int] | None) -> dict[str, str] | None:
    """A demand's index or UNASSIGNED per robot, by names."""
    if choice is None:
        return None
    return {
        robot: team.demands[index].id
        for robot, index in zip(team.robots, choice, strict=True)
        if index != UNASSIGNED
    }


def of_one(team: NamedProblem) -> dict[str, str] | None:
    """Where there is one demand: its best robots, of equals the first."""
    (demand,) = team.demands
    able = [robot for robot in team.robots if robot in demand.candidates]
    able.sort(key=demand.candidates.__getitem__, reverse=True)  # equals stay in their order
    useful = sum(demand.candidates[robot] >= 0 for robot in able)
    if len(able) < demand.lower:
        return None
    count = min(demand.upper, max(demand.lower, useful))
    return dict.fromkeys(able[:count], demand.id)


def of_few(team: NamedProblem) -> dict[str, str] | None:
    """One robot after the other, each along the shortest augmenting path, in whole numbers that
    leave no ties.

    Source: successive shortest paths, Ahuja, Magnanti and Orlin, Network Flows, 1993.
    """
    values, idle = _values(team), len(team.demands)
    bounds = [*((demand.lower, demand.upper) for demand in team.demands), (0, len(values))]
    # A seat below a lower bound is worth more than all else.
    must = 1 + 2 * sum(max(map(abs, row.values())) for row in values)
    members: list[list[int]] = [[] for _ in bounds]
    choice: list[int] = []
    for robot in range(len(values)):
        gains, movers = _ways(robot, values, bounds, members)
        ends = [
            (gain + must if len(members[node]) < bounds[node][0] else gain, node)
            for node, gain in gains.items()
            if len(members[node]) < bounds[node][1]
        ]
        node = max(ends)[1]
        choice.append(idle)
        while (mover := movers[node]) != robot:
            members[node].append(mover)
            node, choice[mover] = choice[mover], node
            members[node].remove(mover)
        members[node].append(robot)
        choice[robot] = node
    if any(len(some) < lower for some, (lower, _) in zip(members, bounds, strict=True)):
        return None
    return named(team, [UNASSIGNED if node == idle else node for node in choice])


def _ways(
    robot: int,
    values: Sequence[dict[int, int]],
    bounds: Sequence[tuple[int, int]],
    members: Sequence[Sequence[int]],
) -> tuple[dict[int, int], dict[int, int]]:
    """For each node the gain of the best way for one more robot to end there, and who moves there.

    On a way the robot takes the place of another one, that one of a third one and so on.
    """
    gains = dict(values[robot])
    movers = dict.fromkeys(gains, robot)
    idle = len(bounds) - 1
    queue = [node for node in gains if node != idle]
    for node in queue:
        lower, upper = bounds[node]
        if lower < len(members[node]) < upper:
            continue  # nobody there is in the way
        for mover in members[node]:
            options = values[mover]
            before = gains[node] - options[node]
            for other, value in options.items():
                gain = before + value
                if other not in gains or gain > gains[other]:
                    gains[other], movers[other] = gain, mover
                    if other != idle:
                        queue.append(other)
    return gains, movers


def _values(team: NamedProblem) -> list[dict[int, int]]:
    """For each robot node -> value; nodes are the demands by their places, then being idle.

    Its performance is followed by a digit: how far in front the demand is, 0 for idle; those of the
    first robot in front. Of optima the canonical one has the greatest number.
    """
    count = len(team.demands)
    unit = place = (count + 1) ** len(team.robots)
    found = []
    for robot in team.robots:
        place //= count + 1
        row = {
            node: demand.candidates[robot] * unit + (count - node) * place
            for node, demand in enumerate(team.demands)
            if robot in demand.candidates
        }
        row[count] = 0
        found.append(row)
    return found
