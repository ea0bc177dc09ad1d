"""I1: same facts and same alive set, same plan. I7: assignments are optimal and canonical."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.assignment.problem import AssignmentProblem, Integers
from mrbt_mesh.core.facts.jobs import COUNTED_ENDS
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.sim.checkers.findings import RunFindings, current_plan

MAX_CHOICES = 2_000
# The first of the best, by trying out all: the tests' oracle, for problems small enough for that.
# Without it, what I7 says of an assignment is that its robots are asked in the order of the rule;
# that it is optimal, the canonical pass proves as it is made.
first_of_the_best: Callable[[AssignmentProblem], Sequence[int] | None] | None = None


def same_plan(run: RunFindings, agents: Iterable[AgentView]) -> None:
    """I1: robots with the same facts and the same alive set hold the same plan."""
    groups: dict[tuple[object, ...], list[AgentView]] = {}
    for agent in agents:
        key = (agent.facts.map.digest(), tuple(sorted(agent.alive().items())))
        groups.setdefault(key, []).append(agent)
    for group in groups.values():
        if len(group) > 1:
            run.checks["I1"] += 1
            if len({current_plan(agent, run.world.solver).packed for agent in group}) > 1:
                names = ", ".join(agent.robot for agent in group)
                run.violation("I1", f"{names} have the same facts, but plan differently")


def optimal_assignment(run: RunFindings, agent: AgentView) -> None:
    """I7: the plan is that of the facts, and its assignment the first of the best.

    The best is found by `first_of_the_best`.
    """
    # Loaded here: it needs an extra.
    from mrbt_mesh.core.assignment.canonical import solve

    problems: list[AssignmentProblem] = []

    def noting(problem: AssignmentProblem) -> Sequence[int] | Integers | None:
        problems.append(problem)
        return run.world.solver(problem)

    noting.supports_constraints = True  # type: ignore[attr-defined]
    plan = make_plan(agent.facts, agent.alive(), noting)
    if current_plan(agent, run.world.solver).packed != plan.packed:
        run.violation("I7", f"the plan of {agent.robot} is not that of its facts")
    for problem in problems:
        run.checks["I7"] += 1
        shares = _shares(agent)
        if list(problem.robots) != sorted(problem.robots, key=lambda r: (shares[r], r)):
            run.violation("I7", f"{agent.robot} assigns robots in the order {problem.robots}")
        choices = math.prod(len(options) + 1 for options in problem.performance)
        if first_of_the_best is None or choices > MAX_CHOICES:
            continue
        best, found = first_of_the_best(problem), solve(problem, run.world.solver)
        if best != found:
            text = f"{agent.robot} assigns {found}, the first of the best is {best}, of {problem}"
            run.violation("I7", text)


def _shares(agent: AgentView) -> Counter[str]:
    """Robot -> on how many of the last jobs that have ended it has worked."""
    jobs, types = agent.facts.jobs, agent.mission.jobs
    ends = []
    for known in jobs or ():
        end = known.written_end
        if end is not None and jobs is not None and not jobs.is_archived(known.id):
            kind = types.get(end.type)
            if kind is None or not kind.ends_mission:
                ends.append((end.stamp, known.id, end.robots))
    latest = sorted(ends)[-COUNTED_ENDS:]
    return Counter(robot for _, _, robots in latest for robot in robots)
