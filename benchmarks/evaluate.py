"""Evaluating a tree from scratch, and again after facts have changed, against py_trees' tick.

Trees of 30, 1,000 and 10,000 nodes, flat, deep and mixed, in the middle of a mission; py_trees
ticks the same trees with the same leaves in between, composites without memory as ours. Ours
gives more: statuses of all nodes, the ordered requests and the names of their activations.
Changed facts are outcomes where the tree is flat, conditions elsewhere; writing them down is not
counted. Medians of CPU time.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from types import ModuleType
from typing import Any

from benchmarks.registry import Benchmark, Result, Setting, Table, need
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status, Tree, build_tree
from mrbt_mesh.core.facts.records import ConditionValue, Member
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.incremental.evaluation.compiled_evaluator import CompiledEvaluator
from mrbt_mesh.core.incremental.evaluation.evaluator import IncrementalEvaluator
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.local_tasks import LocalTask
from mrbt_mesh.core.mission.mission import GlobalTask, Mission, Need, Robot

SIZES = (30, 1_000, 10_000)
CHANGES = (0, 1, 100)
ROBOTS = 5
OUTCOMES = 5_000
REPEAT, QUICK_REPEAT = 40, 8
WARM_UP = 2
IN_A_ROW = 5


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


@dataclass
class Team:
    """Facts, as robots would write them."""

    tree: Tree
    facts: TeamFacts = field(init=False)
    written: int = 0

    def __post_init__(self) -> None:
        names = [node.subject for node in self.tree.actions()]
        conditions = [n.subject for n in self.tree.nodes if n.kind is Kind.CONDITION]
        robots = [f"R{number}" for number in range(ROBOTS)]
        mission = Mission(
            name="bench",
            robots={robot: Robot(robot, "T", {"work": 1_000_000}) for robot in robots},
            robot_types={"T": {}},
            local_tasks={"work": LocalTask("work")},
            conditions={
                name: ConditionType(name, default=name.startswith("true")) for name in conditions
            },
            global_tasks={name: GlobalTask(name, (Need("work", 1, 1),)) for name in names},
            tree=self.tree,
        )
        self.facts = TeamFacts(mission, "r1")
        for robot in robots:
            member = Member("T", {"work": 1_000_000}, {}, False, "", "", 0)
            self.write(robot, "member", member.to_value())

    def write(self, author: str, name: str, value: Any) -> None:
        self.written += 1
        version = Version(Incarnation(1, "n"), self.written)
        self.facts.map.merge([make_entry(author, name, version, value)])

    def flip(self, name: str) -> None:
        facts = self.facts
        value = ConditionValue(
            not facts.condition(name), facts.conditions.revision(name) + 1, facts.max_stamp + 1
        )
        self.write("R0", f"condition/{name}", [value.value, value.revision, value.stamp])

    def succeed(self, activation: str) -> None:
        self.write("R1", f"outcome/{activation}/work", [True, None])


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


class Case:
    """One tree, evaluated by all."""

    def __init__(self, py_trees: ModuleType, shape: str, size: int) -> None:
        self.shape = shape
        self._py_trees = py_trees
        self._tree = build_tree(SHAPES[shape](size))
        self.definition = Evaluator(self._tree)
        self.scratch = CompiledEvaluator(self._tree)
        self._turn = 0
        self._begin()

    def _begin(self) -> None:
        """Facts as in the middle of the mission."""
        self.team = Team(self._tree)
        requests = self.scratch.evaluate(self.team.facts).requests
        for request in requests[1::3]:
            self.team.succeed(request.activation)
        self.again = IncrementalEvaluator(self._tree, self.team.facts)
        self.py_tree = PyTree(self._py_trees, self.team)
        # Where the action below has ended, flipping there and back has it asked for anew.
        units = [n for n in self.py_tree.leaves if n.startswith("done") and n.endswith("_0")]
        self._names = [name for number, name in enumerate(units) if number % 3 != 1]

    def change(self, count: int) -> None:
        """Facts change, for py_trees as well; flat: begins again at the end."""
        if self.shape == "flat":
            if len(self.again.evaluate(self.team.facts).requests) <= count:
                self._begin()
            requests = self.again.evaluate(self.team.facts).requests
            step = max(1, len(requests) // max(1, count))
            for request in requests[self._turn % step :: step][:count]:
                self.team.succeed(request.activation)
                self.py_tree.set(request.subject, Status.SUCCESS)
            self._turn += 1
            return
        for _ in range(min(count, len(self._names))):
            self._turn += 1
            name = self._names[self._turn * 7 % len(self._names)]
            self.team.flip(name)
            status = Status.SUCCESS if self.team.facts.condition(name) else Status.FAILURE
            self.py_tree.set(name, status)

    def influenced(self) -> int:
        """How many nodes have another status after one more change, or ask for something else."""
        before = self.again.evaluate(self.team.facts)
        self.change(1)
        after = self.again.evaluate(self.team.facts)
        asked = {r.node: r for r in before.requests}
        differ = {n for n, s in enumerate(before.statuses) if s != after.statuses[n]}
        return len(differ | {r.node for r in after.requests if asked.get(r.node) != r})

    def evaluations(self, count: int) -> dict[str, list[float]]:
        """One round: `IN_A_ROW` times `count` changes, then the same facts from scratch."""
        again = []
        for _ in range(IN_A_ROW):
            self.change(count)
            again.append(timed(lambda: self.again.evaluate(self.team.facts)))
        return {
            "again": again,
            "scratch": [timed(lambda: self.scratch.evaluate(self.team.facts))],
            "definition": [timed(lambda: self.definition.evaluate(self.team.facts))],
            "py_trees": [timed(self.py_tree.root.tick_once)],
        }

    def check(self) -> None:
        """All come to the same."""
        found = self.again.evaluate(self.team.facts)
        assert found == self.scratch.evaluate(self.team.facts)
        assert found == self.definition.evaluate(self.team.facts)
        self.py_tree.root.tick_once()
        assert self.py_tree.status(found.status) is self.py_tree.root.status


def compare(py_trees: ModuleType, shape: str, size: int, repeat: int) -> Iterator[dict[str, Any]]:
    """Rows of one shape and size, by number of changed facts."""
    case = Case(py_trees, shape, size)
    nodes = len(case.team.tree.nodes)
    case.check()
    for changed in CHANGES:
        if changed * 3 > nodes:
            continue
        rounds = repeat if changed < 2 else max(4, repeat // 4)
        found = [case.evaluations(changed) for _ in range(rounds + WARM_UP)][WARM_UP:]
        row: dict[str, Any] = {"shape": shape, "nodes": nodes, "changed": changed}
        row["influenced"] = case.influenced() if changed == 1 else None
        for name in ("again", "scratch", "definition", "py_trees"):
            row[f"{name}_us"] = round(statistics.median(t for each in found for t in each[name]), 2)
        for name in ("again", "scratch"):
            row[f"py_trees_per_{name}"] = round(row["py_trees_us"] / max(row[f"{name}_us"], 0.1), 1)
        yield row
    case.check()


def worst(py_trees: ModuleType, size: int, repeat: int) -> dict[str, Any]:
    """The leftmost guard turns against everything, and back: all later activations are others."""
    case = Case(py_trees, "mixed", size)
    facts = case.team.facts
    found: dict[str, list[float]] = {"against": [], "back": [], "prune": [], "py_trees": []}
    for _ in range(repeat):
        for name in ("against", "back"):
            case.team.flip("true")
            prune_us = timed(lambda: facts.prune(case.again))
            found[name].append(timed(lambda: case.again.evaluate(facts)))
            if name == "against":
                found["prune"].append(prune_us)
        found["py_trees"].append(timed(case.py_tree.root.tick_once))
        for request in case.again.evaluate(facts).requests[::3]:
            case.team.succeed(request.activation)
        facts.prune(case.again)
    medians = {f"{name}_us": round(statistics.median(each), 1) for name, each in found.items()}
    return {"case": "leftmost guard", "nodes": len(case.team.tree.nodes), **medians}


def pruning(size: int, entries: int, repeat: int) -> dict[str, Any]:
    """What pruning costs with so many outcomes at hand, after one fact of each kind."""
    team = Team(build_tree(flat(size)))
    evaluator = IncrementalEvaluator(team.tree, team.facts)
    requests = evaluator.evaluate(team.facts).requests
    for request in requests[:entries]:
        team.succeed(request.activation)
    team.facts.prune(evaluator)
    outcomes, conditions = [], []
    for request in requests[entries : entries + repeat]:
        team.succeed(request.activation)
        outcomes.append(timed(lambda: team.facts.prune(evaluator)))
        team.flip("true3")
        conditions.append(timed(lambda: team.facts.prune(evaluator)))
    team.flip("true")
    everything_us = timed(lambda: team.facts.prune(evaluator))
    return {
        "case": "pruning",
        "nodes": len(team.tree.nodes),
        "outcomes": entries,
        "after_an_outcome_us": round(statistics.median(outcomes), 2),
        "after_a_condition_us": round(statistics.median(conditions), 2),
        "all_obsolete_us": round(everything_us, 1),
    }


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    timings = ("again", "scratch", "definition", "py_trees")
    head: tuple[str, ...] = ("tree", "nodes", "facts changed", "nodes influenced")
    head += ("again, µs", "from scratch, µs", "definition, µs", "py_trees, µs", "py_trees / again")
    return Table(
        "One tick of a tree",
        (*head, "py_trees / scratch"),
        [
            (
                row["shape"],
                f"{row['nodes']:,}",
                str(row["changed"]),
                str(row["influenced"] or ""),
                *(f"{row[f'{name}_us']:,.1f}" for name in timings),
                *(f"{row[f'py_trees_per_{name}']:,.1f}" for name in timings[:2]),
            )
            for row in rows
        ],
    )


def run(setting: Setting) -> Result:
    """All sizes and shapes, the worst case, and pruning."""
    py_trees = need("py_trees")
    repeat = QUICK_REPEAT if setting.quick else REPEAT
    rows: list[dict[str, Any]] = []
    for size in SIZES[:2] if setting.quick else SIZES:
        for shape in SHAPES:
            setting.say(f"{shape}, {size:,} nodes")
            rows += compare(py_trees, shape, size, repeat)
    size = SIZES[1] if setting.quick else SIZES[-1]
    guard = worst(py_trees, size, repeat // 4)
    pruned = pruning(size, min(OUTCOMES, size // 2), repeat)
    notes = [
        f"The worst case, the leftmost guard of the mixed tree of {guard['nodes']:,} nodes: "
        f"{guard['against_us'] / 1e3:.1f} ms when it turns against everything, "
        f"{guard['back_us'] / 1e3:.1f} ms when it turns back and all activations are others "
        f"(py_trees {guard['py_trees_us'] / 1e3:.1f} ms); dropping the outcomes that are then "
        f"obsolete takes {guard['prune_us'] / 1e3:.1f} ms.",
        f"Pruning {pruned['outcomes']:,} outcomes of {pruned['nodes']:,} nodes: "
        f"{pruned['after_an_outcome_us']:.1f} µs after one more outcome, "
        f"{pruned['after_a_condition_us']:.1f} µs after a condition that guards nothing, "
        f"{pruned['all_obsolete_us'] / 1e3:.1f} ms where all are obsolete at once.",
    ]
    return Result("py_trees", [*rows, guard, pruned], [_table(rows)], notes=notes)


BENCHMARK = Benchmark("one tick of a tree, from scratch and again, against py_trees", run)
