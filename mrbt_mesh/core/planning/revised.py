"""What a revision of the mission would change, of facts as they are now."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from mrbt_mesh.core.bt.activation import Activation
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.team_facts import KnownMember, TeamFacts
from mrbt_mesh.core.facts.validation import has_activation, refusal_reason
from mrbt_mesh.core.mission.jobs import OpenJob, arguments_in
from mrbt_mesh.core.mission.mission import Mission


@dataclass(frozen=True)
class RevisionChanges:
    """All sorted. `kept`: activations with outcomes that stay. `begun_again`: those whose outcomes
    are lost, of global tasks that the revision has too; `dropped`: of those that it has not.
    `going_on` and `cancelled`: (robot, global task, local task) of robots at work. `lost_jobs`:
    open jobs for which it has no type, or other arguments.
    """

    kept: tuple[str, ...]
    begun_again: tuple[str, ...]
    dropped: tuple[str, ...]
    going_on: tuple[tuple[str, str, str], ...]
    cancelled: tuple[tuple[str, str, str], ...]
    new_tasks: tuple[str, ...]
    new_robots: tuple[str, ...]
    removed_robots: tuple[str, ...]
    lost_jobs: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {name: list(value) for name, value in vars(self).items()}


def facts_under(facts: TeamFacts, mission: Mission) -> TeamFacts:
    """The facts as they would be read with this mission in force."""
    found = TeamFacts(mission, facts.run)
    fitting = (
        entry
        for entry in facts.map
        if entry.parts[0] not in records.MISSION_KINDS
        and refusal_reason(entry, mission, facts.run) is None
    )
    found.map.merge(fitting)
    found.prune()
    for name, (member, incarnation) in found.members.items():
        robot = mission.robots.get(name)
        if robot is not None and robot != facts.declared.robots.get(name):
            changed = replace(member, type=robot.type, capabilities=robot.capabilities)
            found.members[name] = KnownMember(changed, incarnation)
    return found


def is_at_work(claim: Claim | None) -> bool:
    """Whether a robot has begun what it claims."""
    return claim is not None and claim.phase is not Phase.CLAIMED


def revision_changes(facts: TeamFacts, mission: Mission) -> RevisionChanges:
    """What becomes of all that is done and under way, if this revision were in force now."""
    after, before = facts_under(facts, mission), facts.declared
    requested = {request.activation for request in after.mission.evaluator.evaluate(after).requests}
    kept: list[str] = []
    again: list[str] = []
    dropped: list[str] = []
    for name, said in sorted(facts.activations.items()):
        if not said.has_outcome:
            continue
        if has_activation(mission, name, facts.run):
            kept.append(name)
        else:
            (again if _has_task(mission, said.activation) else dropped).append(name)
    going_on: list[tuple[str, str, str]] = []
    cancelled: list[tuple[str, str, str]] = []
    for robot in sorted(facts.claims):
        claim = facts.valid_claim(robot)
        if claim is None or not is_at_work(claim):
            continue
        goes_on = claim.activation in requested and robot in mission.robots
        (going_on if goes_on else cancelled).append((robot, claim.global_task, claim.local_task))
    return RevisionChanges(
        tuple(kept),
        tuple(again),
        tuple(dropped),
        tuple(going_on),
        tuple(cancelled),
        tuple(sorted(mission.global_tasks.keys() - before.global_tasks.keys())),
        tuple(sorted(mission.robots.keys() - before.robots.keys())),
        tuple(sorted(before.robots.keys() - mission.robots.keys())),
        tuple(_lost_jobs(facts, mission)),
    )


def _has_task(mission: Mission, activation: Activation) -> bool:
    """Whether the mission, or a type of its jobs, has the global task of an activation."""
    if not activation.job:
        return activation.subject in mission.global_tasks
    patterns = (pattern for kind in mission.jobs.values() for pattern in kind.global_tasks)
    return any(arguments_in(each, activation.subject) is not None for each in patterns)


def _lost_jobs(facts: TeamFacts, mission: Mission) -> list[str]:
    """The labels of open jobs that the mission has no place for."""
    found = []
    for known in facts.jobs if facts.jobs is not None else ():
        job = known.job
        if job is None or known.end is not None:
            continue
        kind = mission.jobs.get(job.type)
        if kind is None or kind.problem(job.arguments):
            found.append(OpenJob(known.id, job.type, job.arguments).label)
    return found
