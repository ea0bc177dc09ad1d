"""Plans made again from recorded facts, by the plain definitions alone."""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan


class PlanAgain:
    """Makes the plans of one mission. The same facts and alive set are planned for once."""

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self._made: dict[tuple[bytes, tuple[tuple[str, Incarnation], ...]], Plan] = {}

    def plan(self, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        """The plan for these facts, with these robots alive."""
        key = (facts.map.digest(), tuple(sorted(alive.items())))
        if key not in self._made:
            self._made[key] = make_plan(facts, alive, default_solver)
        return self._made[key]

    def obsolete(self, facts: TeamFacts) -> list[tuple[str, str]]:
        """Authors and names of the facts that nothing can ask for any more, sorted."""
        names = self.mission.evaluator
        said = facts.activations.values()
        obsolete = [each for each in said if names.is_obsolete(each.activation, facts)]
        return sorted(key for each in obsolete for key in each.keys)
