"""One tick of a tree, against py_trees.

Trees of 30, 1,000 and 10,000 nodes, flat, deep and mixed, in the middle of a mission; py_trees
ticks the same trees with the same leaves in between, composites without memory as ours. Ours
gives more: statuses of all nodes, the ordered requests and the names of their activations.
Medians of CPU time.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from types import ModuleType
from typing import Any

from benchmarks.large import WrittenFacts
from benchmarks.registry import Benchmark, Result, Setting, Table, need
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status, Tree, build_tree
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import MICRO, GlobalTask, LocalTask, Mission, Need, Robot

SIZES = (30, 1_000, 10_000)
ROBOTS = 5
OUTCOMES = 5_000
REPEAT, QUICK_REPEAT = 40, 8


# -- trees ------------------------------------------------------------------------------------


def act(name: str) -> NodeSpec:
    return NodeSpec(Kind.ACTION, subject=name)


def holds(name: str) -> NodeSpec:
    return NodeSpec(Kind.CONDITION, subject=name)


def both(*children: NodeSpec) -> NodeSpec:
    """A Parallel that needs all of its children."""
    return NodeSpec(Kind.PARALLEL, children, limit=len(children))


def flat(size: int) -> NodeSpec:
    """One Parallel of actions and conditions that hold."""
    leaves = (act(f"a{i}") if i % 3 else holds(f"true{i}") for i in range(size - 3))
    return NodeSpec(Kind.SEQUENCE, (holds("true"), both(*leaves)))


def deep(size: int) -> NodeSpec:
    """Chains of Sequences and Fallbacks, 8 to 18 levels deep, side by side."""
    levels = 9 if size >= 1_000 else 4
    chains = []
    for i in range(max(1, size // (4 * levels))):
        chain = act(f"a{i}")
        for level in range(levels):
            chain = NodeSpec(Kind.FALLBACK, (holds(f"done{i}_{level}"), chain))
            chain = NodeSpec(Kind.SEQUENCE, (holds(f"true{i}_{level}"), chain))
        chains.append(chain)
    return NodeSpec(Kind.SEQUENCE, (holds("true"), both(*chains)))


def mixed(size: int) -> NodeSpec:
    """Units of 13 nodes: done already, what must hold, tried again, in time, in parallel."""

    def unit(i: int) -> NodeSpec:
        limited = NodeSpec(Kind.TIMEOUT, (act(f"a{i}"),), timeout_us=60_000_000)
        work = NodeSpec(
            Kind.SEQUENCE,
            (
                holds(f"true{i}"),
                NodeSpec(Kind.INVERTER, (holds(f"blocked{i}"),)),
                NodeSpec(Kind.RETRY, (limited,), limit=3),
                both(act(f"b{i}"), act(f"c{i}")),
            ),
        )
        return NodeSpec(Kind.FALLBACK, (holds(f"done{i}_0"), work))

    def group(first: int, count: int) -> NodeSpec:
        if count == 1:
            return unit(first)
        parts = min(count, 6)
        bounds = [first + count * part // parts for part in range(parts + 1)]
        return both(*(group(a, b - a) for a, b in pairwise(bounds)))

    return NodeSpec(Kind.SEQUENCE, (holds("true"), group(0, max(1, size // 13))))


SHAPES = {"flat": flat, "deep": deep, "mixed": mixed}


# -- a team in the middle of a mission --------------------------------------------------------


class Team(WrittenFacts):
    """A team that carries out a tree."""

    def __init__(self, tree: Tree) -> None:
        conditions = [node.subject for node in tree.nodes if node.kind is Kind.CONDITION]
        names = [node.subject for node in tree.actions()]
        robots = [f"R{number}" for number in range(ROBOTS)]
        super().__init__(
            Mission(
                name="bench",
                robots={robot: Robot(robot, "T", {"work": MICRO}) for robot in robots},
                robot_types={"T": {}},
                local_tasks={"work": LocalTask("work")},
                conditions={
                    name: ConditionType(name, default=name.startswith("true"))
                    for name in conditions
                },
                global_tasks={name: GlobalTask(name, (Need("work", 1, 1),)) for name in names},
                tree=tree,
            )
        )
        self.tree = tree
        for robot in robots:
            self.join(robot)

    def succeed(self, activation: str) -> None:
        self.write("R1", (f"{records.OUTCOME}/{activation}/work", [True, None]))


class PyTree:
    """The same tree for py_trees; its leaves have the statuses that they are given."""

    def __init__(self, py_trees: ModuleType, team: Team) -> None:
        self._py_trees = py_trees
        self.leaves: dict[str, Any] = {}
        self._facts = team.facts
        self._evaluation = Evaluator(team.tree).evaluate(team.facts)
        self._leaf = self._leaf_class()
        self.root = self._build(team.tree, 0)

    def _leaf_class(self) -> Callable[[str, Status], Any]:
        status_of = self.status

        class Leaf(self._py_trees.behaviour.Behaviour):  # type: ignore[misc,name-defined]
            def __init__(self, name: str, status: Status) -> None:
                super().__init__(name)
                self.now = status_of(status)

            def update(self) -> Any:
                return self.now

        return Leaf

    def status(self, status: Status) -> Any:
        """Its status of the same name; nobody has ticked what is idle."""
        return self._py_trees.common.Status[(status or Status.RUNNING).name]

    def _build(self, tree: Tree, index: int) -> Any:
        node, name = tree.nodes[index], str(index)
        children = [self._build(tree, child) for child in node.children]
        composites, decorators = self._py_trees.composites, self._py_trees.decorators
        match node.kind:
            case Kind.ACTION:
                leaf = self._leaf(node.subject, self._evaluation.status_of(index))
                self.leaves[node.subject] = leaf
                return leaf
            case Kind.CONDITION:
                holds = self._facts.condition(node.subject)
                leaf = self._leaf(node.subject, Status.SUCCESS if holds else Status.FAILURE)
                self.leaves[node.subject] = leaf
                return leaf
            case Kind.SEQUENCE:
                return composites.Sequence(name, memory=False, children=children)
            case Kind.FALLBACK:
                return composites.Selector(name, memory=False, children=children)
            case Kind.PARALLEL:
                policy = self._py_trees.common.ParallelPolicy.SuccessOnAll(synchronise=False)
                return composites.Parallel(name, policy, children=children)
            case Kind.INVERTER:
                return decorators.Inverter(name, children[0])
            case Kind.RETRY:
                return decorators.Retry(name, children[0], node.limit)
        return decorators.Timeout(name, children[0], node.timeout_us / 1e6)

    def set(self, name: str, status: Status) -> None:
        """Give a leaf another status."""
        self.leaves[name].now = self.status(status)


# -- measuring --------------------------------------------------------------------------------


def timed(function: Callable[[], object]) -> float:
    """CPU time of one call, in microseconds."""
    began_ns = time.process_time_ns()
    function()
    return (time.process_time_ns() - began_ns) / 1e3


def compare(py_trees: ModuleType, shape: str, size: int, repeat: int) -> dict[str, Any]:
    """One tick of one tree, in the middle of a mission, by both in turn."""
    team = Team(build_tree(SHAPES[shape](size)))
    evaluator = Evaluator(team.tree)
    for request in evaluator.evaluate(team.facts).requests[1::3]:
        team.succeed(request.activation)
    py_tree = PyTree(py_trees, team)
    py_tree.root.tick_once()
    assert py_tree.status(evaluator.evaluate(team.facts).status) is py_tree.root.status
    ours, theirs = [], []
    for _ in range(repeat):
        ours.append(timed(lambda: evaluator.evaluate(team.facts)))
        theirs.append(timed(py_tree.root.tick_once))
    ours_us, theirs_us = statistics.median(ours), statistics.median(theirs)
    return {
        "shape": shape,
        "nodes": len(team.tree.nodes),
        "ours_us": round(ours_us, 2),
        "py_trees_us": round(theirs_us, 2),
        "py_trees_per_ours": round(theirs_us / max(ours_us, 0.1), 1),
    }


def pruning(size: int, entries: int, repeat: int) -> dict[str, Any]:
    """What pruning costs with that many outcomes, after one fact of each kind."""
    team = Team(build_tree(flat(size)))
    requests = Evaluator(team.tree).evaluate(team.facts).requests
    for request in requests[:entries]:
        team.succeed(request.activation)
    team.facts.prune()
    outcomes, conditions = [], []
    for request in requests[entries : entries + repeat]:
        team.succeed(request.activation)
        outcomes.append(timed(team.facts.prune))
        team.turn("true3", "R0")
        conditions.append(timed(team.facts.prune))
    team.turn("true", "R0")
    everything_us = timed(team.facts.prune)
    return {
        "case": "pruning",
        "nodes": len(team.tree.nodes),
        "outcomes": entries,
        "after_an_outcome_us": round(statistics.median(outcomes), 2),
        "after_a_condition_us": round(statistics.median(conditions), 2),
        "all_obsolete_us": round(everything_us, 1),
    }


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    head = ("tree", "nodes", "ours, µs", "py_trees, µs", "py_trees / ours")
    names = ("ours_us", "py_trees_us", "py_trees_per_ours")
    return Table(
        "One tick of a tree",
        head,
        [
            (row["shape"], f"{row['nodes']:,}", *(f"{row[name]:,.1f}" for name in names))
            for row in rows
        ],
    )


def run(setting: Setting) -> Result:
    """All sizes and shapes, and pruning."""
    py_trees = need("py_trees")
    repeat = QUICK_REPEAT if setting.quick else REPEAT
    rows: list[dict[str, Any]] = []
    for size in SIZES[:2] if setting.quick else SIZES:
        for shape in SHAPES:
            setting.say(f"{shape}, {size:,} nodes")
            rows.append(compare(py_trees, shape, size, repeat))
    size = SIZES[1] if setting.quick else SIZES[-1]
    pruned = pruning(size, min(OUTCOMES, size // 2), repeat)
    note = (
        f"Pruning {pruned['outcomes']:,} outcomes of {pruned['nodes']:,} nodes: "
        f"{pruned['after_an_outcome_us']:.1f} µs after one more outcome, "
        f"{pruned['after_a_condition_us'] / 1e3:.1f} ms after a condition has turned, "
        f"{pruned['all_obsolete_us'] / 1e3:.1f} ms where all are obsolete at once."
    )
    return Result("py_trees", [*rows, pruned], [_table(rows)], notes=[note])


BENCHMARK = Benchmark("one tick of a tree, against py_trees", run)
