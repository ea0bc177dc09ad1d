"""I11: no two robots that hear one another act by different revisions of the mission, and what a
dry run says of a revision is what comes of it.
"""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.core.agent.effects import Effect, StartAction
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions.changes import is_at_work, revision_changes
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.features.revisions.kinds import KINDS
from mrbt_mesh.sim.checkers.feature_checker import FeatureChecker
from mrbt_mesh.sim.checkers.findings import RunFindings, joined
from mrbt_mesh.sim.world.process import SimProcess


class Revised(FeatureChecker):
    """Looks at every robot that begins something, and at every one that takes up a revision."""

    def __init__(self, run: RunFindings) -> None:
        super().__init__(run)
        # Before the step, if a revision is proposed: the mission in force, and the facts.
        self._before: tuple[Mission, list[Entry]] | None = None

    def handling(self, process: SimProcess, agent: AgentView, event: Input) -> None:
        facts = agent.facts
        in_force = facts.in_force.number
        is_proposed = facts.index(Revisions).last_number > in_force
        self._before = (facts.in_force, list(facts.map)) if is_proposed else None

    def stepped(self, agent: AgentView) -> None:
        facts = agent.facts
        if self._before is None or self._before[0] is facts.in_force:
            return
        before = TeamFacts(self._before[0], facts.run)
        for entries in (self._before[1], facts.map):
            before.map.merge(each for each in entries if each.parts[0] not in KINDS)
        told = revision_changes(before, facts.in_force)
        self.run.checks["I11"] += 1
        lost = [
            n
            for n in (*told.kept, *told.kept_failed)
            if not (facts.has_outcome(n) or _has_ended(facts, n))
        ]
        left = [name for name in (*told.begun_again, *told.dropped) if facts.has_outcome(name)]
        at_work = {
            (robot, claim.activation, claim.local_task)
            for robot in facts.claims
            if (claim := facts.valid_claim(robot)) is not None and is_at_work(claim)
        }
        taken_off = sorted(set(told.going_on) - at_work)
        for what, names in (
            ("was to stay done and is not", lost),
            ("was to begin again and is done", left),
            ("was to go on and does not", taken_off),
        ):
            if names:
                self.run.violation("I11", f"{agent.robot} takes up a revision: {names} {what}")

    def handled(self, process: SimProcess, effects: Sequence[Effect]) -> None:
        assert process.agent is not None
        for effect in effects:
            if isinstance(effect, StartAction):
                self._begins(process.agent.view, effect)

    def _begins(self, agent: AgentView, start: StartAction) -> None:
        """When a robot begins something, no other one acts by another revision."""
        run, number = self.run, agent.facts.in_force.number
        for other in joined(run.world):
            theirs = other.facts.in_force.number
            if not number and not theirs:
                continue
            run.checks["I11"] += 1
            links = {(agent.robot, other.robot), (other.robot, agent.robot)}
            if (
                theirs != number
                and not links & run.world.network.blocked
                and other.robot in agent.alive()
                and agent.robot in other.alive()
            ):
                run.violation(
                    "I11",
                    f"{agent.robot} begins {start.activation} by revision {number} while "
                    f"{other.robot} acts by revision {theirs}",
                )


def _has_ended(facts: TeamFacts, activation: str) -> bool:
    """Whether it is one of a job that has ended, of which outcomes are dropped."""
    job = parse_activation(activation).job
    return bool(job) and facts.jobs is not None and facts.jobs.has_ended(job)
