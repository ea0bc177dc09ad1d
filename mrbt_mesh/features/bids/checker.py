"""I7: a robot claims what robots bid for only once it has the bids of all living ones."""

from __future__ import annotations

from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.team_facts import capability
from mrbt_mesh.features.bids.facts import bids_of
from mrbt_mesh.features.bids.needs import by_bid
from mrbt_mesh.sim.checkers.barriers import lacked
from mrbt_mesh.sim.checkers.feature_checker import FeatureChecker


class BidsFirst(FeatureChecker):
    """I7: a robot claims what robots bid for only once it has the bids of all living ones.

    Unless the time for bids is over, or another robot already works on the activation.
    """

    def claimed(self, agent: AgentView, claim: Claim) -> None:
        facts, activation = agent.facts, claim.activation
        task = facts.task(activation)
        needs = [need for need in task.needs if by_bid(need)]
        if not needs:
            return
        alive = {r: life for r, life in agent.alive().items() if r in facts.members}
        others = [facts.valid_claim(robot) for robot in alive if robot != agent.robot]
        at_work = [each for each in others if each is not None and each.phase > Phase.CLAIMED]
        if any(each.activation == activation for each in at_work):
            return
        if any(facts.results(activation, need.local_task) for need in task.needs):
            return
        known = bids_of(facts, activation)
        for need in needs:
            if need.local_task in known.closed:
                continue
            self.run.checks["I7"] += 1
            for robot in sorted(alive.keys() - known.of(need.local_task).keys()):
                member, life = facts.members[robot]
                able = capability(member, need.local_task) is not None
                is_asked = able and life == alive[robot] and not member.is_leaving
                # Only robots whose journals can be written begin an exclusive task.
                is_asked &= member.may_promise or not task.at_most_once
                if is_asked and not lacked(facts, activation, robot):
                    text = f"{agent.robot} claims {claim.local_task} of {activation}"
                    self.run.violation("I7", f"{text} without a bid of {robot}")
