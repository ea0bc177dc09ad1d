"""Nodes with memory and reactive ones, held against BehaviorTree.CPP's documented rules.

The reference interpreter ticks a tree on one robot; our evaluation reads the same story as
facts: conditions that change, actions that start when they are asked for and end some steps later.
Left out is what nobody should write: an action in a reactive node before its last child, which
BehaviorTree.CPP starts again at every tick, and here is done once.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.core.bt.tree import Status as Ours
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from tests.support.btcpp import interpreter as btcpp
from tests.support.btcpp.interpreter import Node, Status
from tests.support.build import RUN, World, action, condition, refusal

CONDITIONS = ("c0", "c1", "c2")
STEPS = 24
VERSION = Version(Incarnation(1, "n"), 1)
REMEMBERS = Memory.WHILE_RUNNING
GUARDS = (Kind.SEQUENCE, Kind.FALLBACK)
DECORATORS = (
    Kind.INVERTER,
    Kind.FORCE_SUCCESS,
    Kind.FORCE_FAILURE,
    Kind.RETRY,
    Kind.REPEAT,
    Kind.SUBTREE,
)


# -- random trees -----------------------------------------------------------------------------


@dataclass
class Grower:
    """Grows a random tree of our kinds."""

    random: random.Random
    actions: int = 0

    def tree(self, depth: int = 4) -> NodeSpec:
        return self.grow(depth, with_actions=True)

    def grow(self, depth: int, with_actions: bool) -> NodeSpec:
        roll = self.random.random()
        if depth == 0 or roll < 0.2:
            return self._leaf(with_actions)
        if roll < 0.4:
            kind = self.random.choice(DECORATORS)
            limit = self.random.randint(1, 3) if kind in (Kind.RETRY, Kind.REPEAT) else 0
            child = self.grow(depth - 1, with_actions)
            if kind is Kind.RETRY and with_actions and self.random.random() < 0.3:
                count = self.random.randint(1, 3)
                children = tuple(self.grow(depth - 1, True) for _ in range(count))
                child = NodeSpec(Kind.SEQUENCE, children, memory=Memory.UNTIL_SUCCESS)
            return NodeSpec(kind, (child,), limit=limit)
        kind = self.random.choice((Kind.SEQUENCE, Kind.FALLBACK, Kind.PARALLEL, Kind.IF_THEN_ELSE))
        count = (
            self.random.randint(2, 3) if kind is Kind.IF_THEN_ELSE else self.random.randint(1, 3)
        )
        if kind is Kind.PARALLEL or self.random.random() < 0.6:
            children = tuple(self.grow(depth - 1, with_actions) for _ in range(count))
            limit, failures = 0, 0
            if kind is Kind.PARALLEL:
                limit, failures = self.random.randint(1, count), self.random.randint(0, count)
            return NodeSpec(kind, children, limit=limit, failures=failures, memory=REMEMBERS)
        return NodeSpec(kind, self._reactive_children(kind, count, depth, with_actions))

    def _reactive_children(
        self, kind: Kind, count: int, depth: int, with_actions: bool
    ) -> tuple[NodeSpec, ...]:
        first = 1 if kind is Kind.IF_THEN_ELSE else count - 1
        return tuple(
            self.grow(depth - 1, with_actions) if position >= first else self._guard()
            for position in range(count)
        )

    def _guard(self, depth: int = 2) -> NodeSpec:
        """Conditions that decide together."""
        if depth == 0 or self.random.random() < 0.5:
            guard = condition(self.random.choice(CONDITIONS))
            kinds = (Kind.INVERTER, Kind.SUBTREE, Kind.REPEAT, Kind.RETRY)
            while self.random.random() < 0.3:
                guard = NodeSpec(kind := self.random.choice(kinds), (guard,))
                guard = replace(guard, limit=2 if kind in (Kind.REPEAT, Kind.RETRY) else 0)
            return guard
        kind = self.random.choice((*GUARDS, Kind.PARALLEL, Kind.IF_THEN_ELSE, Kind.INVERTER))
        if kind is Kind.INVERTER:
            return NodeSpec(kind, (self._guard(depth - 1),))
        count = self.random.randint(2, 3)
        children = tuple(self._guard(depth - 1) for _ in range(count))
        if kind is not Kind.PARALLEL:
            return NodeSpec(kind, children)
        limit, failures = self.random.randint(1, count), self.random.randint(0, count)
        return NodeSpec(kind, children, limit=limit, failures=failures, memory=REMEMBERS)

    def _leaf(self, with_actions: bool) -> NodeSpec:
        if with_actions and self.random.random() < 0.7:
            self.actions += 1
            return action(f"a{self.actions}")
        return condition(self.random.choice(CONDITIONS))


def has_place_for_until_success(spec: NodeSpec, is_free: bool = True) -> bool:
    """Whether no node that remembers until it succeeds can be halted, or begun again otherwise
    than by the Retry right above it: BehaviorTree.CPP's then keeps its place, which we do not.
    """
    if spec.kind is Kind.RETRY and spec.children[0].memory is Memory.UNTIL_SUCCESS:
        if not is_free:
            return False
        return all(has_place_for_until_success(c, False) for c in spec.children[0].children)
    if spec.memory is Memory.UNTIL_SUCCESS:
        return False
    is_free = is_free and (spec.kind is Kind.SUBTREE or spec.memory is REMEMBERS)
    is_free = is_free and spec.kind is not Kind.PARALLEL
    return all(has_place_for_until_success(child, is_free) for child in spec.children)


# -- two runs of one story --------------------------------------------------------------------


@dataclass
class Story:
    """What happens to a tree: conditions by step, and how each start of an action ends.

    Conditions change before even steps, actions end at odd ones: both at once would be two events
    for us, of which either may be the first.
    """

    seed: int
    values: list[dict[str, bool]] = field(default_factory=list)

    def __post_init__(self) -> None:
        source = random.Random(f"conditions/{self.seed}")
        now = {name: source.random() < 0.5 for name in CONDITIONS}
        for step in range(STEPS):
            for name in CONDITIONS:
                now[name] ^= step % 2 == 0 and source.random() < 0.25
            self.values.append(dict(now))

    def end(self, name: str, number: int, began: int, step: int) -> bool | None:
        """How the `number`-th start of an action, in step `began`, has ended; None: not yet."""
        source = random.Random(f"{self.seed}/{name}/{number}")
        due = began + source.randint(1, 7)
        success = source.random() < 0.65
        return success if step % 2 == 1 and step >= due else None


# What a tree shows at one step: the root's status, and which start of which action runs.
Shown = tuple[str, tuple[tuple[str, int], ...]]


def reference_run(spec: NodeSpec, story: Story) -> list[Shown]:
    """The story as BehaviorTree.CPP would tell it."""
    starts: Counter[str] = Counter()
    running: dict[str, int] = {}
    step = 0

    def leaf(name: str) -> Callable[[], Status]:
        def tick() -> Status:
            if nodes[name].status is not btcpp.RUNNING:
                running[name] = step
                return btcpp.RUNNING
            success = story.end(name, starts[name], running[name], step)
            if success is None:
                return btcpp.RUNNING
            return btcpp.SUCCESS if success else btcpp.FAILURE

        return tick

    nodes: dict[str, Node] = {}

    def build(node: NodeSpec) -> Node:
        children = [build(child) for child in node.children]
        if node.kind is Kind.ACTION:
            nodes[node.subject] = Node("Action", script=leaf(node.subject), name=node.subject)
            return nodes[node.subject]
        if node.kind is Kind.CONDITION:
            name = node.subject
            return Node(
                "Condition",
                script=lambda: btcpp.SUCCESS if story.values[step][name] else btcpp.FAILURE,
            )
        kind, ports = reference_kind(node)
        return Node(kind, children, ports)

    root, world = build(spec), btcpp.World()
    shown: list[Shown] = []
    for step in range(STEPS):
        status = btcpp.tick(root, world)
        busy = sorted(name for name, node in nodes.items() if node.status is btcpp.RUNNING)
        # One that is halted in the tick that starts it does not count.
        starts.update(name for name in busy if running[name] == step)
        shown.append((status.name, tuple((name, starts[name]) for name in busy)))
        if status is not btcpp.RUNNING:
            break
    return shown


def reference_kind(node: NodeSpec) -> tuple[str, dict[str, object]]:
    """BehaviorTree.CPP's name of a node, and its ports."""
    remembers = node.memory is not Memory.NONE
    match node.kind:
        case Kind.SEQUENCE if node.memory is Memory.UNTIL_SUCCESS:
            return "SequenceWithMemory", {}
        case Kind.SEQUENCE | Kind.FALLBACK:
            return ("" if remembers else "Reactive") + str(node.kind), {}
        case Kind.IF_THEN_ELSE:
            return "IfThenElse" if remembers else "WhileDoElse", {}
        case Kind.PARALLEL:
            allowed = node.failures or len(node.children)
            return "Parallel", {"success_count": node.limit, "failure_count": allowed}
        case Kind.RETRY:
            return "RetryUntilSuccessful", {"num_attempts": node.limit}
        case Kind.REPEAT:
            return "Repeat", {"num_cycles": node.limit}
    return str(node.kind), {}


def our_run(spec: NodeSpec, story: Story) -> list[Shown]:
    """The same story, told in facts."""
    world = World(spec)
    starts: Counter[str] = Counter()
    numbers: dict[str, int] = {}
    began: dict[str, int] = {}
    shown: list[Shown] = []
    for step in range(STEPS):
        for name in CONDITIONS:
            if world.mission.knows_condition(name):
                world.set(name, story.values[step][name])
        asked = world.tick().requests
        for gone in began.keys() - {request.activation for request in asked}:
            del began[gone]  # halted
        while due := _first_due(world, story, numbers, began, step):
            activation, success = due
            del began[activation]
            world.outcome(activation, success)
        asked = world.tick().requests
        for request in asked:
            if request.activation not in began:
                starts[request.subject] += 1
                numbers[request.activation] = starts[request.subject]
                began[request.activation] = step
        busy = sorted((request.subject, numbers[request.activation]) for request in asked)
        status = world.status
        shown.append((status.name, tuple(busy) if status is Ours.RUNNING else ()))
        if status is not Ours.RUNNING:
            break
    return shown


def _first_due(
    world: World, story: Story, numbers: dict[str, int], began: dict[str, int], step: int
) -> tuple[str, bool] | None:
    """The first action in tree order that ends at this step."""
    for request in world.tick().requests:
        if request.activation in began:
            activation = request.activation
            number = numbers[activation]
            success = story.end(request.subject, number, began[activation], step)
            if success is not None:
                return activation, success
    return None


def labelled(spec: NodeSpec) -> str:
    inside = ", ".join(labelled(child) for child in spec.children)
    kind = reference_kind(spec)[0] if spec.children else spec.subject
    limit = f" {spec.limit}/{spec.failures}" if spec.limit else ""
    return f"{kind}{limit}({inside})" if inside else kind


@given(st.integers(0, 1_000_000))
def test_a_random_tree_runs_as_in_behaviortree_cpp(seed: int) -> None:
    spec = Grower(random.Random(f"tree/{seed}")).tree()
    if not has_place_for_until_success(spec):
        return
    story = Story(seed)
    expected, found = reference_run(spec, story), our_run(spec, story)
    assert found == expected, f"seed {seed}\n{labelled(spec)}\n{story.values}"


def test_a_thousand_random_trees_run_as_in_behaviortree_cpp() -> None:
    """The same over fixed seeds, of which enough have something to remember."""
    remembered = 0
    for seed in range(1_000):
        spec = Grower(random.Random(f"tree/{seed}")).tree()
        if has_place_for_until_success(spec):
            story = Story(seed)
            found = our_run(spec, story)
            assert found == reference_run(spec, story), f"seed {seed}\n{labelled(spec)}"
            remembered += found != our_run(forgetful(spec), story)
    assert remembered >= 50


def forgetful(spec: NodeSpec) -> NodeSpec:
    """The same tree without any memory."""
    children = tuple(forgetful(child) for child in spec.children)
    return replace(spec, children=children, memory=Memory.NONE)


# -- single cases -----------------------------------------------------------------------------


def sequence(*children: NodeSpec, memory: Memory = REMEMBERS) -> NodeSpec:
    return NodeSpec(Kind.SEQUENCE, children, memory=memory)


def test_a_condition_that_has_passed_is_not_looked_at_again() -> None:
    world = World(sequence(condition("c"), action("a"), action("b")), true_at_first=("c",))
    assert world.asked() == ["a"]
    world.set("c", False)
    assert world.asked() == ["a"], "a reactive Sequence would have failed"
    world.succeed("a")
    assert world.asked() == ["b"]


def test_a_replica_that_never_saw_the_condition_true_goes_on_as_well() -> None:
    world = World(sequence(condition("c"), action("a")), true_at_first=("c",))
    world.tick()
    world.set("c", False)
    late = world.replayed(reversed(world.entries))
    assert late.asked() == ["a"]


def test_a_guard_above_makes_it_forget() -> None:
    inner = sequence(condition("c"), action("a"))
    world = World(NodeSpec(Kind.SEQUENCE, (condition("on"), inner)), true_at_first=("c", "on"))
    before = world.activation("a")
    world.set("on", False)
    world.set("c", False)
    world.set("on", True)
    assert world.status is Ours.FAILURE, "it begins anew, and reads c again"
    world.set("c", True)
    assert world.activation("a") != before


def test_until_success_a_retry_goes_on_where_it_failed() -> None:
    inner = sequence(action("a"), action("b"), action("d"), memory=Memory.UNTIL_SUCCESS)
    world = World(NodeSpec(Kind.RETRY, (inner,), limit=3))
    world.succeed("a")
    world.fail("b")
    assert world.asked() == ["b"]
    world.succeed("b")
    world.fail("d")
    assert world.asked() == ["d"]
    world.succeed("d")
    assert world.status is Ours.SUCCESS


@pytest.mark.parametrize(("limit", "status"), [(-1, Ours.RUNNING), (3, Ours.FAILURE)])
def test_what_an_earlier_attempt_has_done_uses_up_no_other_one(limit: int, status: Ours) -> None:
    inner = sequence(action("a"), condition("c"), memory=Memory.UNTIL_SUCCESS)
    world = World(NodeSpec(Kind.RETRY, (inner,), limit=limit))
    world.succeed("a")
    assert world.status is status
    assert world.asked() == []
    world.set("c", True)
    assert world.status is Ours.SUCCESS


def test_what_has_passed_is_dropped_once_it_is_out_of_reach() -> None:
    inner = sequence(condition("c"), action("a"))
    world = World(NodeSpec(Kind.SEQUENCE, (condition("on"), inner)), true_at_first=("c", "on"))
    world.tick()
    names = [entry.name for entry in world.facts.map if entry.name.startswith("passed/")]
    assert len(names) == 1
    world.set("on", False)
    world.facts.prune(world.evaluator)
    assert not any(entry.name.startswith("passed/") for entry in world.facts.map)


@pytest.mark.parametrize("position", ["1", "-1", "x", "00"])
def test_nobody_can_say_what_no_node_remembers(position: str) -> None:
    world = World(sequence(action("a"), memory=Memory.NONE))
    entry = make_entry("R1", f"passed/{RUN}:0::: 0/{position}".replace(" ", ""), VERSION, True)
    assert "to remember" in str(refusal(world.facts, entry))
    world = World(sequence(action("a")))
    assert "to remember" in str(refusal(world.facts, entry))
