"""Jobs: work that is handed to a team that runs.

A mission declares *types* of jobs: parameters, and a tree over them below a Jobs node of T_G. A job
is such a type with arguments. `with_jobs` puts the trees of open jobs into the mission's tree, so
that everything else reads an ordinary mission.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import NamedTuple, TypeVar

from mrbt_mesh.core.bt.tree import (
    ATTEMPT_KINDS,
    Kind,
    Memory,
    Node,
    NodeSpec,
    Tree,
    build_tree,
)
from mrbt_mesh.core.mission.mission import GlobalTask, JobType, Mission
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN, PLACEHOLDER, THIS_JOB, bound
from mrbt_mesh.core.mission.program_trees import ProgramTree

_Found = TypeVar("_Found")

# How its jobs have ended is a fact about a Jobs node; there is one run of it.
_NEVER_ABOVE_JOBS = ATTEMPT_KINDS | {
    Kind.INVERTER,
    Kind.FORCE_SUCCESS,
    Kind.FORCE_FAILURE,
    Kind.JOBS,
}


def may_be_above_jobs(kind: Kind, memory: Memory) -> bool:
    """Whether a Jobs node may be below such a node."""
    return kind not in _NEVER_ABOVE_JOBS and memory is Memory.NONE


def most_nodes(tree: Tree, index: int = 0) -> int:
    """How many nodes a tree of the mission file has with as many jobs as it may have at a time."""
    node = tree.nodes[index]
    below = sum(most_nodes(tree, child) for child in node.children)
    return 1 + below * (node.limit if node.kind is Kind.JOBS else 1)


def utc_text(unix_us: int) -> str:
    """A time of a job as text. It is in UTC, so that all users read the same, wherever they are:
    `2026-05-04 10:03:19 UTC`.
    """
    return f"{datetime.fromtimestamp(unix_us // 1_000_000, UTC):%F %T} UTC"


class OpenJob(NamedTuple):
    """A job whose tree is to be in the mission's tree."""

    id: str
    type: str
    arguments: tuple[str, ...]

    @property
    def label(self) -> str:
        """`morning-1: deliver(shelf_2,dock)`."""
        inside = ",".join(self.arguments)
        return f"{self.id}: {self.type}({inside})" if inside else f"{self.id}: {self.type}"


def jobs_nodes(mission: Mission) -> dict[str, Node]:
    """Job type -> the Jobs node that has it."""
    nodes = mission.tree.nodes
    jobs = [node for node in nodes if node.kind is Kind.JOBS]
    return {nodes[child].name: node for node in jobs for child in node.children}


def with_jobs(mission: Mission, jobs: Sequence[OpenJob]) -> Mission:
    """The mission with these jobs in its tree, in this order, in place of the types.

    `mission`: as its file declares it.
    """
    values = {
        job.id: {THIS_JOB: job.id} | mission.jobs[job.type].values_of(job.arguments) for job in jobs
    }
    by_type: dict[str, list[OpenJob]] = {}
    tasks, programs = dict(mission.global_tasks), dict(mission.program_trees)
    at = dict(mission.travel.at) if mission.travel is not None else {}
    for job in jobs:
        known, those = mission.jobs[job.type], values[job.id]
        by_type.setdefault(job.type, []).append(job)
        for task in known.global_tasks.values():
            of_job = bound_task(task, those)
            tasks[of_job.id] = of_job
        for name, program in known.program_trees.items():
            programs[bound(name, those)] = _bound_program(program, those)
        at |= {bound(name, those): bound(place, those) for name, place in known.at.items()}
    order = {job.id: number for number, job in enumerate(jobs)}

    def ground(index: int) -> NodeSpec:
        node = mission.tree.nodes[index]
        if node.kind is not Kind.JOBS:
            return replace(node.spec(tuple(map(ground, node.children))), origin=index)
        found = {
            order[job.id]: _of_job(mission.tree, child, job, values[job.id])
            for child in node.children
            for job in by_type.get(mission.tree.nodes[child].name, ())
        }
        children = tuple(found[number] for number in sorted(found))
        return replace(node.spec(children), origin=index)

    travel = mission.travel
    if travel is not None:
        travel = travel.with_places(at)
    tree = build_tree(ground(0))
    return replace(mission, tree=tree, global_tasks=tasks, program_trees=programs, travel=travel)


def with_one_of_each(mission: Mission) -> Mission:
    """The mission with one job of each type, with the longest of their values, for checks."""
    longest = {name: [p.longest() for p in t.parameters] for name, t in mission.jobs.items()}
    jobs = [OpenJob(name, name, tuple(values)) for name, values in longest.items()]
    return with_jobs(mission, jobs) if jobs else mission


def bound_task(task: GlobalTask, values: Mapping[str, str]) -> GlobalTask:
    """A global task of a job's tree, ground."""
    needs = []
    for need in task.needs:
        before = need.same_robot_as
        if before is not None:
            names = before.global_task, before.local_task
            before = type(before)(*(bound(name, values) for name in names))
        local_task = bound(need.local_task, values)
        needs.append(replace(need, local_task=local_task, same_robot_as=before))
    effects = tuple(sorted({bound(name, values): value for name, value in task.effects}.items()))
    return replace(task, id=bound(task.id, values), needs=tuple(needs), effects=effects)


def _of_job(tree: Tree, index: int, job: OpenJob, values: Mapping[str, str]) -> NodeSpec:
    """A type's tree with the values of a job."""
    node = tree.nodes[index]
    name, subject = bound(node.name, values), bound(node.subject, values)
    children = tuple(_of_job(tree, child, job, values) for child in node.children)
    is_root = tree.nodes[node.parent].kind is Kind.JOBS
    name = job.label if is_root else name
    return replace(node.spec(children), origin=index, job=job.id, name=name, subject=subject)


def _bound_program(tree: ProgramTree, values: Mapping[str, str]) -> ProgramTree:
    ports = tuple((name, bound(value, values)) for name, value in tree.ports)
    outputs = tuple((entry, bound(condition, values)) for entry, condition in tree.outputs)
    return replace(tree, ports=ports, outputs=outputs)


def type_at(mission: Mission, index: int) -> JobType | None:
    """The job type to whose tree a node of the mission file belongs; None: to none."""
    nodes = mission.tree.nodes
    while index > 0:
        parent = nodes[index].parent
        if nodes[parent].kind is Kind.JOBS:
            return mission.jobs[nodes[index].name]
        index = parent
    return None


def arguments_in(pattern: str, ground: str) -> dict[str, str] | None:
    """The values with which a name with placeholders becomes a ground one; None: with none."""
    parts = PLACEHOLDER.split(pattern)
    texts = [f"({ARGUMENT_PATTERN})" if i % 2 else re.escape(part) for i, part in enumerate(parts)]
    found = re.fullmatch("".join(texts), ground)
    values: dict[str, str] = {}
    for parameter, value in zip(parts[1::2], found.groups() if found else (), strict=False):
        if values.setdefault(parameter, value) != value:
            return None
    return values if found else None


def task_of_job(mission: Mission, number: int, subject: str) -> GlobalTask | None:
    """The global task of a leaf of a job's tree, by its ground name; None if it cannot have it.

    `mission`: as its file declares it. Whether there is such a job does not matter.
    """
    index = mission.evaluator.index_of.get((number, ""))
    if index is None:
        return None
    known, pattern = type_at(mission, index), mission.tree.nodes[index].subject
    values = arguments_in(pattern, subject) if known is not None else None
    if known is None or values is None:
        return None
    if any(each.name in values and each.problem(values[each.name]) for each in known.parameters):
        return None
    task = known.global_tasks.get(pattern) or mission.global_tasks.get(pattern)
    return bound_task(task, values) if task is not None else None


def program_tree(mission: Mission, local_task: str) -> ProgramTree | None:
    """The BehaviorTree.CPP tree that this local task is, also in a job's tree; None: it is none."""
    found = mission.program_trees.get(local_task)
    of_job = (
        _of_types(mission, local_task, lambda known: known.program_trees) if not found else None
    )
    return found if of_job is None else _bound_program(*of_job)


def place_at(mission: Mission, local_task: str) -> str:
    """The place where a local task happens, also in a job's tree; empty: anywhere."""
    found = mission.travel.at.get(local_task, "") if mission.travel is not None else ""
    of_job = None if found else _of_types(mission, local_task, lambda kind: kind.at)
    return found if of_job is None else bound(*of_job)


def _of_types(
    mission: Mission, ground: str, table: Callable[[JobType], Mapping[str, _Found]]
) -> tuple[_Found, dict[str, str]] | None:
    """What a table of some job type has under a name that becomes this one, and the values."""
    for known in mission.jobs.values():
        for pattern, found in table(known).items():
            values = arguments_in(pattern, ground)
            if values is not None:
                return found, values
    return None
