"""The width of the fault-free plan: which global tasks it serves at the same time.

The tree is run with all robots in lock-step: every request that *Check Consistency* keeps is
served, all of them finish together, and what comes next is requested. Each condition reads the
value that leads on to work: in a Sequence success, in a Fallback failure while something is left
to try. Repeats go round once.
"""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.analysis.tolerance.service import FaultyTeam, Service, service
from mrbt_mesh.core.bt.evaluation import PresentFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import Kind, Node, NodeSpec, Status, Tree, build_tree
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.consistency import Consistency

_ONCE = frozenset({Kind.RETRY, Kind.REPEAT, Kind.KEEP_RUNNING_UNTIL_FAILURE, Kind.TIMEOUT})


class StuckError(ValueError):
    """The fault-free team cannot serve any of the requests; the message names them."""


def widths(mission: Mission) -> list[Service]:
    """What the fault-free plan serves at one time, stage by stage.

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
    """What the tree reads: every leaf has a name of its own, and ends as the run wants it."""

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
        """The first branch that leads on to work."""
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
        """The value that leads on to work."""
        return self.wanted[int(name)] is Status.SUCCESS

    def task_status(self, subject: str, activation: str) -> Status:
        """Served requests end as the tree wants them."""
        del activation
        index = int(subject)
        return self.wanted[index] if index in self.done else Status.RUNNING
