"""The steps of a plan, each using what has not changed since the plan before."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solve import optimum
from mrbt_mesh.core.bt.evaluation import Evaluation, Request
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.incremental.assignment.reassign import Reassigner
from mrbt_mesh.core.incremental.consistency.keeper import ConsistencyKeeper
from mrbt_mesh.core.incremental.planning.bids import FollowedBids
from mrbt_mesh.core.incremental.planning.capabilities import FollowedCapabilities
from mrbt_mesh.core.incremental.planning.demands import FollowedDemands
from mrbt_mesh.core.planning.bids import Bids
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker
from mrbt_mesh.core.planning.consistency import Kept
from mrbt_mesh.core.planning.demands import Demand, Group
from mrbt_mesh.core.planning.plan import Line, Waiting
from mrbt_mesh.core.planning.steps import PlanningSteps


@dataclass(frozen=True, slots=True)
class _Open:
    """What a demand still asks for, beside the `held` robots that are pinned to it."""

    demand: Demand
    held: int
    named: NamedDemand


class IncrementalSteps(PlanningSteps):
    """For one plan after the other, of one team."""

    def __init__(self, evaluator: Evaluator, solver: Solver) -> None:
        super().__init__(evaluator, solver)
        self._capabilities = FollowedCapabilities()
        self._demands = FollowedDemands(evaluator)
        self._bids = FollowedBids()
        self._consistency = ConsistencyKeeper()
        self._reassigner = Reassigner(partial(optimum, solver=solver))
        self._open: dict[str, _Open] = {}
        self._lines: dict[tuple[str, bool], tuple[Demand, Line]] = {}
        self._waiting: dict[str, tuple[Group, Waiting]] = {}
        # Of the plan before: what it does not ask for again is forgotten.
        self._open_before: dict[str, _Open] = {}
        self._waiting_before: dict[str, tuple[Group, Waiting]] = {}

    def evaluate(self, facts: TeamFacts) -> Evaluation:
        self._open_before, self._open = self._open, {}
        self._waiting_before, self._waiting = self._waiting, {}
        return super().evaluate(facts)

    def capabilities(self, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Capabilities:
        self._capabilities.follow(facts, alive)
        return self._capabilities

    def demands(
        self, facts: TeamFacts, requests: Sequence[Request], capabilities: Capabilities
    ) -> list[Group]:
        return self._demands.follow(facts, requests, capabilities)

    def bids(self, facts: TeamFacts, groups: Sequence[Group], team: Mapping[str, Worker]) -> Bids:
        return self._bids.follow(facts, groups, team)

    def keep(
        self,
        facts: TeamFacts,
        groups: Sequence[Group],
        team: Mapping[str, Worker],
        excluded: Collection[int],
    ) -> Kept:
        if facts.mission.constraints:
            return super().keep(facts, groups, team, excluded)
        return self._consistency.kept_requests(facts, groups, team, excluded)

    def assign(self, problem: NamedProblem) -> Mapping[str, str] | None:
        return self._reassigner.update(problem)

    def open_demand(self, demand: Demand, held: int) -> NamedDemand:
        name = f"{demand.request.activation}/{demand.local_task}"
        known = self._open_before.get(name)
        if known is None or known.demand is not demand or known.held != held:
            known = _Open(demand, held, super().open_demand(demand, held))
        self._open[name] = known
        return known.named

    def line(self, robot: str, demand: Demand, pinned: bool) -> Line:
        known = self._lines.get((robot, pinned))
        if known is None or known[0] is not demand:
            known = self._lines[robot, pinned] = demand, super().line(robot, demand, pinned)
        return known[1]

    def waiting(
        self,
        facts: TeamFacts,
        group: Group,
        capabilities: Capabilities,
        obstacle: str,
        awaited: tuple[str, ...],
    ) -> Waiting:
        activation = group[0].request.activation
        known = self._waiting_before.get(activation)
        if (
            known is None
            or known[0] is not group
            or (known[1].obstacle, known[1].awaited) != (obstacle, awaited)
        ):
            known = group, super().waiting(facts, group, capabilities, obstacle, awaited)
        self._waiting[activation] = known
        return known[1]
