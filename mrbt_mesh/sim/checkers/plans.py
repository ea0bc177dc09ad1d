"""I1: same facts and same alive set give the same plan. I7: assignments are optimal, canonical."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.problem import AssignmentProblem, Integers
from mrbt_mesh.core.assignment.solvers import brute_force
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.team_facts import capability
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.sim.checkers.barriers import lacked
from mrbt_mesh.sim.checkers.findings import RunFindings, current_plan

MAX_CHOICES = 2_000


class SamePlan:
    """I1: robots with the same facts and the same alive set hold the same plan."""

    def __init__(self, findings: RunFindings) -> None:
        self._findings = findings

    def sample(self, agents: Iterable[AgentView]) -> None:
        groups: dict[tuple[object, ...], list[AgentView]] = {}
        for agent in agents:
            key = (agent.facts.map.digest(), tuple(sorted(agent.alive().items())))
            groups.setdefault(key, []).append(agent)
        for group in groups.values():
            if len(group) > 1:
                self._findings.checks["I1"] += 1
                solver = self._findings.world.solver
                plans = {current_plan(agent, solver).packed for agent in group}
                if len(plans) > 1:
                    names = ", ".join(agent.robot for agent in group)
                    self._findings.say("I1", f"{names} have the same facts, but plan differently")


class OptimalAssignment:
    """I7: what is assigned is what trying out everything finds first, on cases that are small.

    Looks at one robot's plan per sample, in turn; it must also be the plan that follows from
    the facts as they are now, evaluated from scratch.
    """

    def __init__(self, findings: RunFindings) -> None:
        self._findings = findings
        self._turn = 0

    def sample(self, agents: Sequence[AgentView]) -> None:
        if not agents:
            return
        self._turn += 1
        agent = agents[self._turn % len(agents)]
        problems: list[AssignmentProblem] = []

        def noting(problem: AssignmentProblem) -> Sequence[int] | Integers | None:
            problems.append(problem)
            return self._findings.world.solver(problem)

        noting.supports_constraints = True  # type: ignore[attr-defined]
        plan = make_plan(agent.facts, agent.alive(), noting)
        if current_plan(agent, self._findings.world.solver).packed != plan.packed:
            self._findings.say("I7", f"the plan of {agent.robot} is not that of its facts")
        for problem in problems:
            self._check(agent, problem)

    def _check(self, agent: AgentView, problem: AssignmentProblem) -> None:
        if math.prod(len(options) + 1 for options in problem.performance) > MAX_CHOICES:
            return
        self._findings.checks["I7"] += 1
        best = brute_force(problem)
        found = solve(problem, self._findings.world.solver)
        if best != found:
            text = f"{agent.robot} assigns {found}, the first of the best is {best}, of {problem}"
            self._findings.say("I7", text)
        if list(problem.robots) != sorted(problem.robots):
            self._findings.say("I7", f"{agent.robot} assigns robots in the order {problem.robots}")


class BidsFirst:
    """I7 needs the bids: nobody claims what robots bid for while a bid of the living is missing,
    unless it was waited for long enough, or somebody else is at work on the activation already.
    """

    def __init__(self, findings: RunFindings) -> None:
        self._findings = findings

    def claimed(self, agent: AgentView, claim: Claim) -> None:
        """The agent has just made this claim."""
        facts, activation = agent.facts, claim.activation
        needs = agent.mission.global_tasks[claim.global_task].needs
        alive = {r: life for r, life in agent.alive().items() if r in facts.members}
        others = [facts.valid_claim(robot) for robot in alive if robot != agent.robot]
        at_work = [each for each in others if each is not None and each.phase > Phase.CLAIMED]
        if any(each.activation == activation for each in at_work):
            return
        if any(facts.results(activation, need.local_task) for need in needs):
            return
        for need in needs:
            said = facts.bids(activation)
            if not need.by_bid or need.local_task in said.closed:
                continue
            self._findings.checks["I7"] += 1
            bids = said.of(need.local_task)
            for robot in sorted(alive.keys() - bids.keys()):
                member, life = facts.members[robot]
                able = capability(member, need.local_task) is not None
                if lacked(facts, activation, robot):
                    continue  # it is not asked
                if able and life == alive[robot] and not member.is_leaving:
                    text = f"{agent.robot} claims {claim.local_task} of {activation}"
                    self._findings.say("I7", f"{text} without a bid of {robot}")
