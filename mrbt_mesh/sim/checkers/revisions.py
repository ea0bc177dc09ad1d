"""I11: no two robots that hear one another act by different revisions of the mission."""

from __future__ import annotations

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.validation import has_activation
from mrbt_mesh.sim.checkers.findings import RunFindings, joined


def one_revision(run: RunFindings, agent: AgentView, start: StartAction) -> None:
    """When a robot begins something, no other one acts by another revision."""
    facts = agent.facts
    if not facts.is_revised:
        return
    run.checks["I11"] += 1
    number, blocked = facts.declared.revision_number, run.world.network.blocked
    for other in joined(run.world):
        links = {(agent.robot, other.robot), (other.robot, agent.robot)}
        if (
            other.action is None
            or links & blocked
            or other.robot not in agent.alive()
            or agent.robot not in other.alive()
        ):
            continue
        theirs, works_on = other.facts.declared, other.action.activation
        if theirs.revision_number != number and not has_activation(
            facts.declared, works_on, facts.run
        ):
            run.violation(
                "I11",
                f"{agent.robot} begins {start.activation} by revision {number} while "
                f"{other.robot} is at {works_on} by revision {theirs.revision_number}",
            )
