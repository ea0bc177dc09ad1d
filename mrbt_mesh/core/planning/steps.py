"""The steps of which a plan is made, each by its definition.

`make_plan` says in which order they are taken. What is faster takes the place of this class and
gives the same answers (`core.incremental`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solve import optimum
from mrbt_mesh.core.bt.evaluation import Evaluation, Request
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.bids import Bids, bids_for
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker, capabilities_of
from mrbt_mesh.core.planning.consistency import Consistency, Kept, kept_requests, shortages
from mrbt_mesh.core.planning.demands import Demand, Group, demands_of
from mrbt_mesh.core.planning.plan import Line, Waiting
from mrbt_mesh.core.planning.side_constraints import SideConstraintCheck


class PlanningSteps:
    """From facts to statuses, demands, kept requests and an assignment. It keeps nothing."""

    def __init__(self, evaluator: Evaluator, solver: Solver) -> None:
        self.evaluator = evaluator
        self.solver = solver

    def evaluate(self, facts: TeamFacts) -> Evaluation:
        """T_G over the facts: statuses, and requests in tree order."""
        return self.evaluator.evaluate(facts)

    def capabilities(self, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Capabilities:
        """The robots that the plan may use, and what they can do."""
        return capabilities_of(facts, alive)

    def demands(
        self, facts: TeamFacts, requests: Sequence[Request], capabilities: Capabilities
    ) -> list[Group]:
        """What each request asks of the team: the bounds of the paper's assignment problem."""
        return demands_of(facts, requests, capabilities, self.evaluator)

    def bids(self, facts: TeamFacts, groups: Sequence[Group], team: Mapping[str, Worker]) -> Bids:
        """What bids make of the demands."""
        return bids_for(facts, groups, team)

    def keep(
        self,
        facts: TeamFacts,
        groups: Sequence[Group],
        team: Mapping[str, Worker],
        excluded: Collection[int],
    ) -> Kept:
        """*Check Consistency*: the requests that can be served together."""
        constraints = facts.mission.constraints
        if constraints:
            robots = list(team)
            return kept_requests(
                facts, groups, lambda: SideConstraintCheck(constraints, robots, groups), excluded
            )
        return kept_requests(facts, groups, lambda: Consistency(team), excluded)

    def assign(self, problem: NamedProblem) -> Mapping[str, str] | None:
        """*Assign Agents*: robot -> demand, the canonical optimum; None if infeasible."""
        return optimum(problem, self.solver)

    # -- what is said of them -----------------------------------------------------------------

    def open_demand(self, demand: Demand, held: int) -> NamedDemand:
        """What a demand still asks for, beside the `held` robots that are pinned to it."""
        name = f"{demand.request.activation}/{demand.local_task}"
        lower, upper = max(0, demand.lower - held), demand.upper - held
        return NamedDemand(name, lower, upper, demand.candidates)

    def line(self, robot: str, demand: Demand, pinned: bool) -> Line:
        """One robot's line of the plan."""
        request = demand.request
        return Line(
            robot,
            request.activation,
            request.subject,
            demand.local_task,
            demand.candidates[robot],
            pinned,
        )

    def waiting(
        self,
        facts: TeamFacts,
        group: Group,
        capabilities: Capabilities,
        obstacle: str,
        awaited: tuple[str, ...],
    ) -> Waiting:
        """Why a request is not served."""
        short = () if obstacle or awaited else shortages(facts, group, capabilities)
        request = group[0].request
        return Waiting(request.activation, request.subject, short, obstacle, awaited=awaited)
