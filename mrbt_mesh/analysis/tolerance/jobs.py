"""The fault tolerance of job types: of each type alone, with the worst arguments.

One job of the type is the whole mission. Its arguments matter only if robots have capabilities for
single local tasks (`lift(3)`): each value that such a capability names is tried, and one of the
others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import Any

from mrbt_mesh.analysis.tolerance.analyse import Analysis, Say, analyse
from mrbt_mesh.analysis.tolerance.requirement import TooLargeError
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Tree, build_tree
from mrbt_mesh.core.mission.jobs import OpenJob, with_jobs
from mrbt_mesh.core.mission.mission import Costs, JobParameter, JobType, Mission
from mrbt_mesh.core.mission.names import split_call, type_name

MAX_COMBINATIONS = 100
# How many combinations are tried to find arguments that a job may have.
MAX_TRIED = 10_000


@dataclass(frozen=True)
class JobAnalysis:
    """A type of jobs, the arguments with which it survives the fewest faults, and its analysis."""

    type: str
    arguments: tuple[str, ...]
    analysis: Analysis

    @property
    def scarce(self) -> tuple[str, ...]:
        """The types of the local tasks of those global tasks that can lose the fewest robots."""
        tasks = self.analysis.tasks
        least = min((task.slack for task in tasks), default=0)
        needs = (need for task in tasks if task.slack == least for need in task.needs)
        return tuple(sorted({type_name(local_task) for local_task, _, _ in needs}))

    def to_json(self) -> dict[str, Any]:
        """Return plain data, like that of a mission."""
        found = {"arguments": list(self.arguments), "scarce": list(self.scarce)}
        return found | self.analysis.to_json()


def analyse_jobs(
    mission: Mission, costs: Costs, limit_s: float, say: Say = lambda *_: None
) -> list[JobAnalysis]:
    """Analyse each type of a mission's jobs, by name; for `limit_s` see `analyse`.

    Raises TooLargeError for a type with too many combinations, of its tree or its arguments.
    """
    found = []
    for name, known in sorted(mission.jobs.items()):
        each = [
            JobAnalysis(name, arguments, analyse(one, costs, limit_s, say))
            for arguments, one in single_jobs(mission, known)
        ]
        found.append(min(each, key=_tolerated))
    return found


def _tolerated(job: JobAnalysis) -> tuple[int, ...]:
    """Sort key: greater if more faults are survived."""
    main = job.analysis.main
    kinds = (main.major, main.minor)
    fewest = (-1 if k.min_fatal.value is None else k.min_fatal.value for k in kinds)
    most = (-1 if k.max_tolerated.value is None else k.max_tolerated.value for k in kinds)
    if not main.question.reading.is_feasible:
        return (-1,)
    return (0, *fewest, *most)


def single_jobs(mission: Mission, known: JobType) -> Iterator[tuple[tuple[str, ...], Mission]]:
    """Yield missions of one job, for arguments of every kind that makes a difference."""
    named = _named_values(mission, known)
    choices = [_representatives(each, named[each.name]) for each in known.parameters]
    fitting = (args for args in islice(product(*choices), MAX_TRIED) if not known.problem(args))
    found = list(islice(fitting, MAX_COMBINATIONS + 1))
    if len(found) > MAX_COMBINATIONS:
        text = f"jobs of type {known.name} differ in more than {MAX_COMBINATIONS} ways"
        raise TooLargeError(f"{text}, by the capabilities for single arguments")
    for arguments in found:
        yield arguments, _single_job(mission, known.name, arguments)


def _named_values(mission: Mission, known: JobType) -> Mapping[str, set[str]]:
    """Return parameter -> texts in capabilities for single local tasks."""
    able = [name for robot in mission.robots.values() for name in robot.capabilities]
    texts = {text for name in able for text in split_call(name)[1]}
    return {
        each.name: {text for text in texts if not each.problem(text)} for each in known.parameters
    }


def _representatives(parameter: JobParameter, named: set[str]) -> list[str]:
    """Return the named values, and one of the others if there are any."""
    other = next((value for value in parameter.values() if value not in named), None)
    return [*sorted(named), *([] if other is None else [other])]


def _single_job(mission: Mission, name: str, arguments: tuple[str, ...]) -> Mission:
    """Return the mission whose tree is that of one job."""
    whole = with_jobs(mission, [OpenJob(name, name, arguments)])
    nodes = whole.tree.nodes
    root = next(n.index for n in nodes if n.job and nodes[n.parent].kind is Kind.JOBS)
    tree = build_tree(_plain(whole.tree, root))
    asked = {node.subject for node in tree.actions()}
    tasks = {name: task for name, task in whole.global_tasks.items() if name in asked}
    title = f"{mission.name}: one job {name}({', '.join(arguments)})"
    return replace(whole, name=title, tree=tree, global_tasks=tasks, jobs={})


def _plain(tree: Tree, index: int) -> NodeSpec:
    """Return a subtree of a job, as in a mission without jobs."""
    node = tree.nodes[index]
    children = tuple(_plain(tree, child) for child in node.children)
    return replace(node.spec(children), origin=-1, job="")
