"""The questions about a mission: its services, and which of them are required."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from mrbt_mesh.analysis.tolerance.bound import bound_services
from mrbt_mesh.analysis.tolerance.fault_counts import Reading
from mrbt_mesh.analysis.tolerance.requirement import (
    ALWAYS,
    Formulas,
    Requirement,
    every,
    tree_requirement,
)
from mrbt_mesh.analysis.tolerance.service import FaultyTeam, Service, service, somebody
from mrbt_mesh.core.bt.evaluation import PresentFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import Kind, Node, NodeSpec, Status, Tree, build_tree
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.consistency import Consistency

_ONCE = frozenset({Kind.RETRY, Kind.REPEAT, Kind.KEEP_RUNNING_UNTIL_FAILURE, Kind.TIMEOUT})


@dataclass(frozen=True)
class Question:
    """A reading, and the obstacle if the mission is not feasible at all."""

    reading: Reading
    obstacle: str = ""


def serial(mission: Mission) -> Question:
    """The tree runs serially if necessary: each required task can be served alone."""
    services, numbers, deciding = serial_services(mission)

    def waits(task: str) -> bool:
        return mission.global_tasks[task].blocked_fail_after_us is None

    required = tree_requirement(mission.tree, numbers, waits, deciding)
    if required is None:
        return Question(_impossible(mission, services), "the tree itself can never succeed")
    return _checked(Reading(mission, services, required))


def serial_services(
    mission: Mission,
) -> tuple[tuple[Service, ...], dict[str, list[int]], dict[str, int]]:
    """Return the services of a mission.

    Also returns global task -> the services needed to perform it, and -> the service needed to
    fail.
    """
    services, numbers = _tasks(mission)
    deciding: dict[str, int] = {}
    for task in mission.global_tasks.values():
        if task.at_most_once and task.blocked_fail_after_us is not None:
            # A blocked task fails only if a living majority can decide it.
            deciding[task.id] = len(services)
            services = (*services, Service(f"a majority for {task.id}", (task.id,), (), True))
    return (*services, somebody(mission)), numbers, deciding


def every_task(mission: Mission) -> Question:
    """No alternative is given up: every global task of the tree can be served alone."""
    services, _ = _tasks(mission)
    required = every(range(len(services)))
    return _checked(Reading(mission, (*services, somebody(mission)), required))


def parallel_width(mission: Mission) -> Question:
    """What the fault-free plan serves at the same time stays feasible together."""
    try:
        stages = tuple({each.tasks: each for each in widths(mission)}.values())
    except StuckError as error:
        return Question(_impossible(mission, ()), str(error))
    tasks = dict.fromkeys(task for stage in stages for task in stage.tasks)
    for task in tasks:
        stages = (*stages, *bound_services(mission, mission.global_tasks[task]))
    required = every(range(len(stages)))
    return _checked(Reading(mission, (*stages, somebody(mission)), required))


READINGS: dict[str, Callable[[Mission], Question]] = {
    "serial": serial,
    "keeps_every_task": every_task,
    "keeps_parallel_width": parallel_width,
}


def _tasks(mission: Mission) -> tuple[tuple[Service, ...], dict[str, list[int]]]:
    """Return a service per global task alone, and global task -> the services it needs."""
    tasks = mission.global_tasks.values()
    services = [service(mission, (task,), task.id) for task in tasks]
    numbers = {each.name: [number] for number, each in enumerate(services)}
    for task in tasks:
        bound = bound_services(mission, task)
        numbers[task.id] += range(len(services), len(services) + len(bound))
        services += bound
    return tuple(services), {task: _all_before(mission, task, numbers) for task in numbers}


def _all_before(mission: Mission, task: str, numbers: Mapping[str, list[int]]) -> list[int]:
    """Return the services of a task and of the tasks whose robots it needs."""
    seen, waiting = dict.fromkeys([task]), [task]
    for each in waiting:
        befores = [need.same_robot_as for need in mission.global_tasks[each].needs]
        new = [b.global_task for b in befores if b and b.global_task not in seen]
        seen |= dict.fromkeys(new)
        waiting += new
    return [number for each in seen for number in numbers[each]]


def _impossible(mission: Mission, services: tuple[Service, ...]) -> Reading:
    return Reading(mission, services, Requirement(Formulas(), ALWAYS))


def _checked(reading: Reading) -> Question:
    last = len(reading.services) - 1  # somebody
    if not reading.required.is_ruined(range(last)):
        # Conditions alone may suffice, but a living robot has to read them.
        formulas = reading.required.formulas
        ruin = formulas.any((reading.required.ruin, formulas.atom(last)))
        reading = replace(reading, required=Requirement(formulas, ruin))
    if reading.is_feasible:
        return Question(reading)
    names = ", ".join(reading.services[each].name for each in sorted(reading.at_first))
    return Question(reading, f"even without faults the robots cannot do {names}")


# -- the width of the fault-free plan -------------------------------------------------------------
# Which global tasks it serves at the same time: the tree is run with all robots in lock-step.
# Every request that *Check Consistency* keeps is served, all of them finish together, and what
# comes next is requested. Each condition reads the value that leads on to work: in a Sequence
# success, in a Fallback failure while something is left to try. Repeats go round once.


class StuckError(ValueError):
    """The fault-free team cannot serve any of the requests; the message names them."""


def widths(mission: Mission) -> list[Service]:
    """Return what the fault-free plan serves at the same time, stage by stage.

    Raises StuckError if it gets stuck.
    """
    run = _LockStep(mission.tree)
    evaluator = Evaluator(run.tree)
    team = FaultyTeam(mission)
    stages: list[Service] = []
    demands = {
        task.id: [team.demand(need) for need in service(mission, (task,), task.id).needs]
        for task in mission.global_tasks.values()
    }
    while requests := evaluator.evaluate(run).requests:
        together = Consistency(team.alive)
        subjects = {request.node: mission.tree.nodes[request.node].subject for request in requests}
        kept = [
            node for node, subject in subjects.items() if together.keep(node, demands[subject], {})
        ]
        if not kept:
            names = ", ".join(subjects.values())
            raise StuckError(f"the robots cannot do {names}, even without faults")
        tasks = tuple(mission.global_tasks[subjects[node]] for node in kept)
        stages.append(service(mission, tasks, " + ".join(task.id for task in tasks)))
        run.done.update(kept)
    return stages


class _LockStep(PresentFacts):
    """The facts that the tree reads: each leaf has its own name, and ends as the run wants it."""

    def __init__(self, tree: Tree) -> None:
        self._acts = tree.containing(Kind.ACTION)
        self.wanted = [Status.SUCCESS] * len(tree.nodes)
        self._want(tree)
        self.tree = build_tree(self._named(tree, 0))
        self.done: set[int] = set()

    def _want(self, tree: Tree) -> None:
        for node in tree.nodes:
            wanted = self.wanted[node.index]
            opposite = Status.FAILURE if wanted is Status.SUCCESS else Status.SUCCESS
            passing = {Kind.SEQUENCE: Status.SUCCESS, Kind.FALLBACK: Status.FAILURE}.get(node.kind)
            if node.kind is Kind.IF_THEN_ELSE:
                self._want_a_branch(node, wanted)
                continue
            for child in node.children:
                if node.kind is Kind.INVERTER:
                    self.wanted[child] = opposite
                elif passing is None:
                    self.wanted[child] = wanted
                else:
                    is_last = child == node.children[-1]
                    leads_on = not is_last and not (self._acts[child] and wanted is not passing)
                    self.wanted[child] = passing if leads_on else wanted

    def _want_a_branch(self, node: Node, wanted: Status) -> None:
        """Choose the first branch that leads on to work."""
        condition, *branches = node.children
        works = [self._acts[branch] for branch in branches]
        is_then = works[0] or not any(works)
        self.wanted[condition] = Status.SUCCESS if is_then else Status.FAILURE
        for branch in branches:
            self.wanted[branch] = wanted

    def _named(self, tree: Tree, index: int) -> NodeSpec:
        node = tree.nodes[index]
        children = tuple(self._named(tree, child) for child in node.children)
        if node.kind in _ONCE:
            return NodeSpec(Kind.SUBTREE, children)
        spec = NodeSpec(node.kind, children, node.name, node.subject, node.limit)
        return spec if children else replace(spec, subject=str(index))

    def condition(self, name: str) -> bool:
        """Return the value that leads on to work."""
        return self.wanted[int(name)] is Status.SUCCESS

    def task_status(self, subject: str, activation: str) -> Status:
        """End served requests as the tree wants them."""
        del activation
        index = int(subject)
        return self.wanted[index] if index in self.done else Status.RUNNING
