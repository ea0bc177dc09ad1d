"""What a revision of the mission would change, of facts as they are now."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any

from mrbt_mesh.core.bt.activation import Activation, parse_activation
from mrbt_mesh.core.bt.tree import Node, Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.activation_facts import ActivationFacts
from mrbt_mesh.core.facts.records import Claim, Decision, Phase
from mrbt_mesh.core.facts.team_facts import KnownMember, TeamFacts
from mrbt_mesh.core.facts.validation import ACTIVATION_KINDS
from mrbt_mesh.core.mission.jobs import OpenJob, arguments_in, type_at
from mrbt_mesh.core.mission.mission import GlobalTask, Mission, MissionEnd, performance


@dataclass(frozen=True)
class RevisionChanges:
    """All sorted. `kept`: activations with outcomes that stay. `begun_again`: those whose outcomes
    are lost, of global tasks that the revision begins anew; `dropped`: of those that it does not
    have there. `repeated`: those of `exclusive` tasks that are done, may be done, or are in doubt,
    and would be begun anew. `going_on` and `cancelled`: (robot, global task, local task) of robots
    at work. `lost_jobs`: open jobs for which it has no type, or other arguments. `ended_jobs`: open
    jobs that end with it, and whether they succeed or fail. `result`: how the mission ends with it.
    """

    kept: tuple[str, ...]
    begun_again: tuple[str, ...]
    dropped: tuple[str, ...]
    repeated: tuple[str, ...]
    going_on: tuple[tuple[str, str, str], ...]
    cancelled: tuple[tuple[str, str, str], ...]
    new_tasks: tuple[str, ...]
    new_robots: tuple[str, ...]
    removed_robots: tuple[str, ...]
    lost_jobs: tuple[str, ...]
    ended_jobs: tuple[tuple[str, str], ...] = ()
    result: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {n: v if isinstance(v, str) else list(v) for n, v in vars(self).items()}


def facts_under(facts: TeamFacts, mission: Mission) -> TeamFacts:
    """The facts as they would be read with this revision in force."""
    found = TeamFacts(mission, facts.run)
    found.map.merge(each for each in facts.map if each.parts[0] not in records.MISSION_KINDS)
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


def revision_changes(
    facts: TeamFacts, mission: Mission, alive: Collection[str] | None = None
) -> RevisionChanges:
    """What becomes of all that is done and under way, if this revision were in force now.

    `alive`: the robots whose work counts; None: all.
    """
    after, before = facts_under(facts, mission), facts.declared
    evaluation = after.mission.evaluator.evaluate(after)
    requested = {request.activation for request in evaluation.requests}
    kept = sorted(name for name, said in after.activations.items() if said.has_outcome)
    fresh = _Fresh(facts, mission)
    again: list[str] = []
    dropped: list[str] = []
    for name, said in sorted(facts.activations.items()):
        if said.has_outcome and not after.has_outcome(name):
            (again if fresh.task(said.activation) else dropped).append(name)
    going_on: list[tuple[str, str, str]] = []
    cancelled: list[tuple[str, str, str]] = []
    for robot in sorted(facts.claims):
        claim = facts.valid_claim(robot)
        if claim is None or not is_at_work(claim) or (alive is not None and robot not in alive):
            continue
        able = robot in mission.robots and performance(
            after.members[robot].member.capabilities, claim.local_task
        )
        goes_on = claim.activation in requested and able
        (going_on if goes_on else cancelled).append((robot, claim.global_task, claim.local_task))
    ended_before = {end.job for end in facts.mission.evaluator.evaluate(facts).job_ends}
    ended = {end.job: end.success for end in evaluation.job_ends if end.job not in ended_before}
    is_over = mission.ends is MissionEnd.ONCE and evaluation.status is not Status.RUNNING
    return RevisionChanges(
        tuple(kept),
        tuple(again),
        tuple(dropped),
        tuple(sorted(fresh.repeated(after))),
        tuple(going_on),
        tuple(cancelled),
        tuple(sorted(mission.global_tasks.keys() - before.global_tasks.keys())),
        tuple(sorted(mission.robots.keys() - before.robots.keys())),
        tuple(sorted(before.robots.keys() - mission.robots.keys())),
        tuple(_lost_jobs(facts, mission)),
        tuple((job, "succeeds" if ended[job] else "fails") for job in sorted(ended)),
        evaluation.status.name.lower() if is_over else "",
    )


class _Fresh:
    """The actions of a revision that no mission before had: nothing of them is done."""

    def __init__(self, facts: TeamFacts, mission: Mission) -> None:
        known = facts.declared.revision
        first = len(facts.declared.tree.nodes) if known is None else known.next_node
        self._facts = facts
        self._mission = mission
        self._nodes = [node for node in mission.tree.actions() if node.number >= first]

    def task(self, activation: Activation) -> GlobalTask | None:
        """The global task of an activation, if it is that of such an action, in the same job."""
        for node in self._nodes:
            if self._is_of(node, activation):
                kind = type_at(self._mission, node.index)
                tasks = self._mission.global_tasks if kind is None else kind.global_tasks
                return tasks.get(node.subject) or self._mission.global_tasks[node.subject]
        return None

    def _is_of(self, node: Node, activation: Activation) -> bool:
        kind = type_at(self._mission, node.index)
        if kind is None or not activation.job:
            return kind is None and not activation.job and node.subject == activation.subject
        jobs = self._facts.jobs
        known = jobs.known.get(activation.job) if jobs is not None else None
        if known is None or known.job is None or known.job.type != kind.name or known.has_ended:
            return False
        values = arguments_in(node.subject, activation.subject)
        given = dict(zip((p.name for p in kind.parameters), known.job.arguments, strict=False))
        return values is not None and all(given.get(n) == value for n, value in values.items())

    def repeated(self, after: TeamFacts) -> Iterator[str]:
        """The activations of exclusive tasks that were begun, are nothing after the revision, and
        would be begun anew.
        """
        for name, said in self._all().items():
            if name in after.activations or (task := self.task(said.activation)) is None:
                continue
            if _may_be_done(said) or (task.exclusive and _has_success(said)):
                yield name

    def _all(self) -> dict[str, ActivationFacts]:
        """All activations that are known, also those of earlier missions."""
        found: dict[str, ActivationFacts] = {}
        for entry in self._facts.unbelieved():
            if entry.parts[0] in ACTIVATION_KINDS:
                name = entry.parts[1]
                said = found.setdefault(name, ActivationFacts(parse_activation(name)))
                said.add(entry)
        return found | self._facts.activations


def _may_be_done(said: ActivationFacts) -> bool:
    """Whether an exclusive activation is done, or may be: it is under way, or in doubt."""
    coalitions, is_done = said.coalitions, said.is_decided(Decision.DONE)
    if is_done or coalitions is None or not coalitions.grants:
        return is_done
    return _has_success(said) or any(map(coalitions.is_open, coalitions.grants))


def _has_success(said: ActivationFacts) -> bool:
    found = [said.outcomes, *(said.coalitions.outcomes.values() if said.coalitions else ())]
    return any(success for each in found for ends in each.values() for success in ends.values())


def _lost_jobs(facts: TeamFacts, mission: Mission) -> list[str]:
    """The labels of open jobs that the mission has no place for, and had one."""
    found = []
    for known in facts.jobs if facts.jobs is not None else ():
        job = known.job
        if job is None or known.end is not None or (facts.jobs and not facts.jobs.fits(job)):
            continue
        kind = mission.jobs.get(job.type)
        if kind is None or kind.problem(job.arguments):
            found.append(OpenJob(known.id, job.type, job.arguments).label)
    return found
