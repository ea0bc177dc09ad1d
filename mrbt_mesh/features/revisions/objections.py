"""Why a team does not take up a revision of its mission, and what the operator can do about it.

A robot refuses what these say; `mrbt revise` says it before it proposes anything.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.feature import features
from mrbt_mesh.core.mission.jobs import with_one_of_each
from mrbt_mesh.core.mission.mission import GlobalTask, Mission
from mrbt_mesh.core.planning.ahead import tasks_ahead
from mrbt_mesh.core.planning.capabilities import Capabilities, workers
from mrbt_mesh.core.planning.consistency import could_be_met
from mrbt_mesh.core.planning.demands import Demand
from mrbt_mesh.features.revisions.changes import RevisionChanges, facts_under, step_name, step_names

# Loops without a limit ask for tasks for ever.
MOST_AHEAD = 200
FORCE = "--force"


def objections(
    facts: TeamFacts,
    mission: Mission,
    changes: RevisionChanges,
    alive: Mapping[str, Incarnation],
    *,
    is_forced: bool = False,
    may_repeat: bool = False,
) -> list[str]:
    """Why a revision is refused, each with the remedy; empty if it is not.

    `alive`: the robots of the team. `is_forced` and `may_repeat`: what the operator says.
    """
    found = [
        f"it has no place for the open job {job}: cancel it first" for job in changes.lost_jobs
    ]
    if not may_repeat:
        found += _repeated(changes)
    if not is_forced:
        found += _without_force(facts, mission, changes, alive)
    return found


def _repeated(changes: RevisionChanges) -> Iterator[str]:
    for name in step_names(changes.repeated):
        yield from filter(None, (feature.objects_to_repeat(name) for feature in features()))


def _without_force(
    facts: TeamFacts,
    mission: Mission,
    changes: RevisionChanges,
    alive: Mapping[str, Incarnation],
) -> Iterator[str]:
    before = facts.in_force.name
    if mission.name != before:
        yield (
            f"it is the mission {mission.name}, and this team runs {before}: give the right file "
            f"or team, or use {FORCE}"
        )
    leaving = [robot for robot in changes.removed_robots if robot in alive]
    if leaving:
        names, are = ", ".join(leaving), "is" if len(leaving) == 1 else "are"
        yield f"{names} {are} alive and would leave: keep {names} in it, or use {FORCE}"
    for robot, step, _ in changes.cancelled:
        yield (
            f"{robot} works on {step_name(step)}, which would be cancelled: wait until that has "
            f"ended, or use {FORCE}"
        )
    lacking, known = _lacking(facts_under(facts, mission), alive), _lacking(facts, alive)
    for task, text in lacking.items():
        if known.get(task) != text:
            yield f"{text}: give the team robots that can, or use {FORCE}"


def not_feasible(facts: TeamFacts, mission: Mission, alive: Mapping[str, Incarnation]) -> list[str]:
    """What the robots that are alive cannot do of a revision, whichever of them are free: of what
    it asks for now and later, if all succeeds, and of one job of each type.

    What a robot cannot use yet, as while an operator has borrowed it, counts as its own.
    """
    return list(_lacking(facts_under(facts, mission), alive).values())


def _lacking(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> dict[str, str]:
    """Global task -> what robots it lacks."""
    named = {robot: life for robot, life in alive.items() if robot in facts.in_force.robots}
    team = {
        robot: replace(worker, member=replace(worker.member, pending={}))
        for robot, worker in workers(facts, named).items()
    }
    able, found = Capabilities(team), dict[str, str]()
    for tree in (facts.mission, with_one_of_each(facts.in_force)):
        evaluation = tree.evaluator.evaluate(facts)
        for requests in tasks_ahead(tree.evaluator, facts, evaluation, MOST_AHEAD):
            for request in requests:
                task = tree.global_tasks[request.subject]
                if task.id not in found and (text := _lacks(task, request, able)):
                    found[task.id] = text
    return found


def _lacks(task: GlobalTask, request: Request, able: Capabilities) -> str:
    """What robots a task lacks; empty if there are enough."""
    group = [
        Demand(request, n.local_task, least, least, least, (), able.able(n.local_task))
        for n in task.needs
        if (least := n.min_robots)
    ]
    if could_be_met(group, able.team):
        return ""
    short = [each for each in group if len(each.candidates) < each.lower] or group
    needs = ", ".join(f"{each.lower} for {each.local_task}" for each in short)
    there = ", ".join(str(len(each.candidates)) for each in short)
    return f"the robots that are alive cannot do {task.id}: it needs {needs}, and {there} can"
