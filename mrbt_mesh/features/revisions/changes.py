"""What a revision of the mission would change, of facts as they are now."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from mrbt_mesh.core.bt.activation import Activation, parse_activation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.activation_facts import ActivationFacts
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.team_facts import KnownMember, TeamFacts
from mrbt_mesh.core.facts.validation import ACTIVATION_KINDS, task_of_activation
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.jobs import OpenJob, type_at
from mrbt_mesh.core.mission.mission import GlobalTask, Mission, MissionEnd, performance
from mrbt_mesh.core.mission.names import THIS_JOB, bound
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.features.revisions.kinds import KINDS, MAX_MISSION
from mrbt_mesh.features.revisions.revise import RevisionError, revise


@dataclass(frozen=True)
class RevisionChanges:
    """All sorted. `kept` and `kept_failed`: activations with outcomes that stay, the latter without
    a success. `begun_again`: those whose outcomes do not count, of steps that the revision begins
    anew; `dropped`: of steps that it does not have. `repeated`: for each step that it begins
    anew and whose task is or was to be done at most once, an activation that is done, or may be.
    `new_tasks`: steps that it adds, by name. `going_on` and `cancelled`: (robot, activation, local
    task) of robots at work. `lost_jobs`: open jobs for which it has no type, or other arguments.
    `ended_jobs`: open jobs that end with it, and whether they succeed or fail. `result`: how the
    mission ends with it.
    """

    kept: tuple[str, ...]
    kept_failed: tuple[str, ...]
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
        """Plain data, with the names of steps for their activations."""
        data = {n: v if isinstance(v, str) else list(v) for n, v in vars(self).items()}
        of_steps = ("kept", "kept_failed", "begun_again", "dropped", "repeated")
        data |= {name: step_names(data[name]) for name in of_steps}
        for name, works in (("going_on", self.going_on), ("cancelled", self.cancelled)):
            data[name] = [[robot, step_name(step), task] for robot, step, task in works]
        return data


def step_names(activations: Iterable[str]) -> list[str]:
    """The names of the steps of activations, each once."""
    return [*dict.fromkeys(map(step_name, activations))]


def step_name(activation: str) -> str:
    """The global task of an activation, and its job if it has one."""
    found = parse_activation(activation)
    return _name_of(found.subject, found.job)


def _name_of(subject: str, job: str) -> str:
    return f"{subject} of {job}" if job else subject


def facts_under(facts: TeamFacts, mission: Mission) -> TeamFacts:
    """The facts as they would be read with this revision in force."""
    found = TeamFacts(mission, facts.run)
    found.map.merge(each for each in facts.map if each.parts[0] not in KINDS)
    found.prune()
    for name, (member, incarnation) in found.members.items():
        robot = mission.robots.get(name)
        if robot is not None and robot != facts.in_force.robots.get(name):
            changed = replace(member, type=robot.type, capabilities=robot.capabilities)
            found.members[name] = KnownMember(changed, incarnation)
    return found


def as_revision(facts: TeamFacts, mission: Mission) -> Mission:
    """The mission as the next revision of the one in force; raises RevisionError if no team could
    take it up.
    """
    found = revise(facts.in_force, mission, facts.index(Revisions).last_number + 1)
    size = len(compile_mission(found))
    if size > MAX_MISSION:
        text = f"compiled it has {size} characters, and a revision at most {MAX_MISSION}"
        raise RevisionError(text)
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
    after, before = facts_under(facts, mission), facts.in_force
    evaluation = after.mission.evaluator.evaluate(after)
    requested = {request.activation for request in evaluation.requests}
    ended_here = {name: said for name, said in after.activations.items() if _has_ended(said)}
    steps = _Steps(facts, mission, after, alive)
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
        (going_on if goes_on else cancelled).append((robot, claim.activation, claim.local_task))
    ended_before = {end.job for end in facts.mission.evaluator.evaluate(facts).job_ends}
    ended = {end.job: end.success for end in evaluation.job_ends if end.job not in ended_before}
    is_over = mission.ends is MissionEnd.ONCE and evaluation.status is not Status.RUNNING
    return RevisionChanges(
        tuple(sorted(name for name, said in ended_here.items() if _is_done(said))),
        tuple(sorted(name for name, said in ended_here.items() if not _is_done(said))),
        tuple(sorted(steps.begun_again())),
        tuple(sorted(steps.dropped())),
        tuple(sorted(steps.repeated())),
        tuple(going_on),
        tuple(cancelled),
        tuple(sorted(steps.new())),
        tuple(sorted(mission.robots.keys() - before.robots.keys())),
        tuple(sorted(before.robots.keys() - mission.robots.keys())),
        tuple(_lost_jobs(facts, mission)),
        tuple((job, "succeeds" if ended[job] else "fails") for job in sorted(ended)),
        evaluation.status.name.lower() if is_over else "",
    )


class _Step(NamedTuple):
    """Steps that are one for the operator: the same task with the same arguments, in the same job
    (empty: in the tree of the team), whatever guards it.
    """

    subject: str
    job: str


class _Steps:
    """What a revision begins, by steps, and what was done of these, also in earlier missions."""

    def __init__(
        self,
        facts: TeamFacts,
        mission: Mission,
        after: TeamFacts,
        alive: Collection[str] | None,
    ) -> None:
        self._facts, self._mission, self._after, self._alive = facts, mission, after, alive
        self._before, self._now = _numbers(facts, facts.in_force), _numbers(facts, mission)
        self._known: dict[_Step, dict[str, ActivationFacts]] = {}
        for name, said in self._all().items():
            step = _Step(said.activation.subject, said.activation.job)
            self._known.setdefault(step, {})[name] = said
        # Nodes of which something counts with the revision, by number and job.
        begun = (each.activation for each in after.activations.values() if _is_begun(each))
        self._begun = {(each.node, each.job) for each in begun}
        self._fresh = {step: self._fresh_numbers(step) for step in self._now}

    def begun_again(self) -> Iterator[str]:
        """The activations with outcomes that count no more, of steps that begin anew."""
        return (name for step, fresh in self._fresh.items() if fresh for name in self._lost(step))

    def dropped(self) -> Iterator[str]:
        """The activations with outcomes that count now, of steps that it does not have."""
        for step in self._known.keys() - self._now.keys():
            yield from (name for name in self._lost(step) if name in self._facts.activations)

    def new(self) -> Iterator[str]:
        """The steps that were not in the tree before, or fewer times, and of which nothing is done
        that counts no more.
        """
        for step, fresh in self._fresh.items():
            lost = {self._known[step][name].activation.node for name in self._lost(step)}
            is_more = len(self._now[step]) > len(self._before.get(step, ()))
            if is_more and len(fresh) > len(lost):
                yield _name_of(*step)

    def repeated(self) -> Iterator[str]:
        """Of each step that is done at most once and begins anew, an activation that was begun. It
        is done at most once if its task is, or was when it was begun.
        """
        for step, fresh in self._fresh.items():
            tasks = [self._task(self._mission, number, step) for number in fresh]
            is_once = any(task is not None and task.at_most_once for task in tasks)
            known = sorted(self._known.get(step, {}).items()) if fresh else ()
            begun = [
                name
                for name, said in known
                if _may_be_done(said) or (is_once and _has_success(said))
            ]
            begun += self._at_work(step, is_once) if fresh else []
            yield from begun[:1]

    def _fresh_numbers(self, step: _Step) -> list[int]:
        """The nodes of a step that the tree in force does not have, and of which nothing counts."""
        before = self._before.get(step, ())
        return [n for n in self._now[step] if n not in before and (n, step.job) not in self._begun]

    def _lost(self, step: _Step) -> list[str]:
        known = self._known.get(step, {})
        ended = [name for name, said in known.items() if _has_ended(said)]
        return [name for name in ended if not _has_ended_in(self._after, name)]

    def _at_work(self, step: _Step, is_once: bool) -> Iterator[str]:
        """What robots have begun of a step that is done at most once, or will be."""
        for robot in sorted(self._facts.claims):
            claim = self._facts.valid_claim(robot)
            is_alive = self._alive is None or robot in self._alive
            if claim is None or claim.phase is not Phase.RUNNING or not is_alive:
                continue
            held = parse_activation(claim.activation)
            task = self._facts.task_of(claim.activation)
            if (held.subject, held.job) == step and (is_once or (task and task.at_most_once)):
                yield claim.activation

    def _task(self, mission: Mission, number: int, step: _Step) -> GlobalTask | None:
        return task_of_activation(
            Activation(self._facts.run, number, step.subject, (), 0, step.job), mission
        )

    def _all(self) -> dict[str, ActivationFacts]:
        """All activations that are known, also those of earlier missions."""
        found: dict[str, ActivationFacts] = {}
        for entry in self._facts.unbelieved():
            if entry.parts[0] in ACTIVATION_KINDS:
                name = entry.parts[1]
                said = found.setdefault(name, ActivationFacts(parse_activation(name)))
                said.add(entry)
        return found | self._facts.activations


def _numbers(facts: TeamFacts, mission: Mission) -> dict[_Step, list[int]]:
    """The numbers of the nodes of each step of a mission, with those of the jobs that are open."""
    found: dict[_Step, list[int]] = {}
    jobs = [known for known in facts.jobs if known.end is None] if facts.jobs is not None else []
    for node in mission.tree.actions():
        kind = type_at(mission, node.index)
        if kind is None:
            found.setdefault(_Step(node.subject, ""), []).append(node.number)
            continue
        for known in jobs:
            job = known.job
            if job is not None and job.type == kind.name and not kind.problem(job.arguments):
                values = {THIS_JOB: known.id} | kind.values_of(job.arguments)
                step = _Step(bound(node.subject, values), known.id)
                found.setdefault(step, []).append(node.number)
    return found


def _has_ended(said: ActivationFacts) -> bool:
    """Whether a robot has ended here, or an operator has decided that it is done."""
    return said.has_outcome or said.verdict is True


def _has_ended_in(facts: TeamFacts, activation: str) -> bool:
    said = facts.activations.get(activation)
    return said is not None and _has_ended(said)


def _is_begun(said: ActivationFacts) -> bool:
    return _has_ended(said) or _may_be_done(said)


def _is_done(said: ActivationFacts) -> bool:
    return said.verdict is True or _has_success(said)


def _may_be_done(said: ActivationFacts) -> bool:
    """Whether a task that is done at most once is done, or may be."""
    return said.joint is not None and said.joint.may_be_done()


def _has_success(said: ActivationFacts) -> bool:
    has_own = any(success for ends in said.outcomes.values() for success in ends.values())
    return has_own or (said.joint is not None and said.joint.has_success)


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
