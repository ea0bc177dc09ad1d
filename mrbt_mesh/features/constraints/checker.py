"""I13: a plan with which a robot begins keeps the side constraints."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.plan import RobotAssignment
from mrbt_mesh.features.constraints.kinds import (
    AtMost,
    Constraint,
    NeverTogether,
    NotAtOnce,
    constraints_of,
)
from mrbt_mesh.sim.checkers.feature_checker import FeatureChecker


class KeepsConstraints(FeatureChecker):
    """I13: a plan never assigns more of the robots that a constraint limits than it allows.

    Robots that worked before are not stopped, so that there may be as many as before.
    """

    def started(self, agent: AgentView, start: StartAction) -> None:
        plan, run = agent.plan, self.run
        if plan is None:
            return
        for constraint in constraints_of(agent.mission):
            run.checks["I13"] += 1
            for found in limited(constraint, plan.assignments):
                before = [robot for robot in found if found[robot].pinned]
                count, was = len(found), len(before)
                most = 1 if isinstance(constraint, NeverTogether) else constraint.count
                if isinstance(constraint, NotAtOnce):
                    count = len({each.activation for each in found.values()})
                    was = len({found[robot].activation for robot in before})
                if count > max(was, most):
                    text = f"{agent.robot} begins {start.local_task} of {start.activation}"
                    run.violation("I13", f"{text} beside {', '.join(sorted(found))}: {constraint}")


def limited(
    constraint: Constraint, assignments: Mapping[str, RobotAssignment]
) -> Sequence[Mapping[str, RobotAssignment]]:
    """Return the assignments that count together.

    For `NeverTogether` there is one mapping per local task of a request.
    """
    if isinstance(constraint, NotAtOnce):
        names = constraint.global_tasks
        return [{r: a for r, a in assignments.items() if is_named(a.global_task, names)}]
    mine = {r: a for r, a in assignments.items() if r in constraint.robots}
    if isinstance(constraint, AtMost):
        return [mine]
    places: dict[tuple[str, str], dict[str, RobotAssignment]] = {}
    for robot, each in mine.items():
        if not constraint.local_tasks or is_named(each.local_task, constraint.local_tasks):
            places.setdefault((each.activation, each.local_task), {})[robot] = each
    return list(places.values())


def allowed(constraint: Constraint, doers: Mapping[str, str]) -> bool:
    """True if these robots may carry out these local tasks of one global task."""
    if isinstance(constraint, NotAtOnce):
        return True  # it is about several global tasks
    theirs = [doers[robot] for robot in constraint.robots if robot in doers]
    if isinstance(constraint, AtMost):
        return len(theirs) <= constraint.count
    names = constraint.local_tasks
    together = [each for each in theirs if not names or is_named(each, names)]
    return len(set(together)) == len(together)


def is_named(ground: str, names: Collection[str]) -> bool:
    """True if `names` contain the task's ground name or its type."""
    return ground in names or type_name(ground) in names
