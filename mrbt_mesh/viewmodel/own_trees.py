"""T_A and T_Li of one robot, with the statuses of their nodes as far as they can be seen."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from mrbt_mesh.core.bt.evaluation import OwnFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.robot_tree import (
    ASSIGN_AGENTS,
    ASSIGNED,
    CHECK_CONSISTENCY,
    LOCAL_TASK_FINISHED,
    NEW_GLOBAL_TASK_EXECUTED,
    assignment_tree,
    local_tree,
)
from mrbt_mesh.core.bt.tree import Status, Tree
from mrbt_mesh.core.mission.mission import Mission, performance
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.viewmodel.mission_view import tree_view


def local_tree_of(mission: Mission, capabilities: Mapping[str, int]) -> Tree:
    """T_Li of a robot that can do this; local tasks that are trees of their own are spelt out."""
    trees = {name: tree.spec() for name, tree in mission.local_trees.items()}
    trees = {name: spec for name, spec in trees.items() if performance(capabilities, name)}
    able = {type_name(name) for name in capabilities}
    names = able - {type_name(name) for name in mission.local_trees} | trees.keys()
    return local_tree(names, trees)


def own_trees(observer: Observer, robot: str) -> dict[str, Any]:
    """`T_A` and `T_Li`: nodes and statuses. Raises KeyError for a robot without a description.

    T_A's as of the last plan; inside a local task that is a tree of its own nothing is seen.
    """
    member = observer.facts.members[robot].member
    plan, claim = observer.plan, observer.claim(robot)
    holding: set[str] = {LOCAL_TASK_FINISHED, NEW_GLOBAL_TASK_EXECUTED}
    assigning = Status.RUNNING
    if plan is not None:
        holding |= {CHECK_CONSISTENCY} if plan.consistent else set()
        assigning = Status.SUCCESS if plan.feasible else Status.FAILURE
    tree = local_tree_of(observer.mission, member.capabilities)
    assigned: set[str] = set()
    if claim is not None:
        names = {claim.local_task, type_name(claim.local_task)}
        assigned = {ASSIGNED, *(f"{ASSIGNED}({name})" for name in names)}
    return {
        "robot": robot,
        "T_A": _evaluated(assignment_tree(), holding, {ASSIGN_AGENTS: assigning}),
        "T_Li": _evaluated(tree, assigned, {}),
    }


def _evaluated(tree: Tree, holding: Iterable[str], actions: dict[str, Status]) -> dict[str, Any]:
    evaluation = Evaluator(tree).evaluate(OwnFacts(frozenset(holding), actions))
    return {"tree": tree_view(tree), "statuses": list(evaluation.statuses)}
