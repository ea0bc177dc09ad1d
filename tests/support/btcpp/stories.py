"""Random trees and stories, told by the executor of a robot's own trees and in facts.

The executor ticks a tree as BehaviorTree.CPP does on one robot
(tests/btcpp/executor/test_tree_executor_traces.py); our evaluation reads the same story as facts:
conditions that change, actions that start when they are asked for and end some steps later, and may
set conditions when they do. Left out is what nobody should write: an action in a reactive node
before its last child, which BehaviorTree.CPP starts again at every tick, and here is done once.
"""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import dataclass, field, replace

from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus, TreeNode
from mrbt_mesh.btcpp.files.elements import Element, write_content
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.core.bt.tree import Status as Ours
from tests.support.btcpp.conformance import Shown, steps
from tests.support.build import World, action, condition

CONDITIONS = ("c0", "c1", "c2")
STEPS = 24
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
    actions_set: bool = False
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

    def set_by_sensors(self, now: dict[str, bool], step: int) -> None:
        """Bring what has changed before this step into `now`."""
        before = self.values[step - 1] if step else {}
        now.update({n: v for n, v in self.values[step].items() if before.get(n) != v})

    def set_by(self, name: str, number: int) -> dict[str, bool]:
        """The conditions that the `number`-th start of an action sets when it ends."""
        if not self.actions_set:
            return {}
        source = random.Random(f"{self.seed}/{name}/{number}/sets")
        return {each: source.random() < 0.5 for each in CONDITIONS if source.random() < 0.4}


def reference_run(spec: NodeSpec, story: Story) -> list[Shown]:
    """The story as BehaviorTree.CPP would tell it."""
    starts: Counter[str] = Counter()
    running: dict[str, int] = {}
    step = 0
    now: dict[str, bool] = {}
    was_set: dict[str, bool] = {}

    class Act(TreeNode):
        def tick(self) -> NodeStatus:
            name = self.name
            if self.status is not NodeStatus.RUNNING:
                running[name] = step
                return NodeStatus.RUNNING
            success = story.end(name, starts[name], running[name], step)
            if success is None:
                return NodeStatus.RUNNING
            was_set.update(story.set_by(name, starts[name]))
            now.update(was_set)
            return NodeStatus.SUCCESS if success else NodeStatus.FAILURE

    class Ask(TreeNode):
        def tick(self) -> NodeStatus:
            return NodeStatus.SUCCESS if now[self.name] else NodeStatus.FAILURE

    leaves = Leaves()
    leaves.node("Act")(Act)
    leaves.node("Ask")(Ask)
    body = write_content(reference_xml(spec))
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    executor = BehaviorTree.from_text(text, None, leaves).executor
    nodes = {node.name: node for node in executor.nodes if isinstance(node, Act)}
    for node in executor.nodes:
        node.yields = False  # a story's tick decides all that can be decided
    shown: list[Shown] = []
    for step in range(STEPS):
        story.set_by_sensors(now, step)
        was_set.clear()
        status = executor.tick(step)
        if was_set and status is NodeStatus.RUNNING:
            status = executor.tick(step)
        busy = sorted(name for name, node in nodes.items() if node.status is NodeStatus.RUNNING)
        # One that is halted in the tick that starts it does not count.
        starts.update(name for name in busy if running[name] == step)
        shown.append((status.name, tuple((name, starts[name]) for name in busy)))
        if status is not NodeStatus.RUNNING:
            break
    return shown


def reference_xml(node: NodeSpec) -> Element:
    """A tree as BehaviorTree.CPP's XML."""
    if node.kind in (Kind.ACTION, Kind.CONDITION):
        tag = "Act" if node.kind is Kind.ACTION else "Ask"
        return Element(tag, {"name": node.subject})
    kind, ports = reference_kind(node)
    # A SubTree's place makes no difference here; a Sequence of one child is as transparent.
    element = Element("Sequence" if kind == "SubTree" else kind)
    element.attributes = {name: str(value) for name, value in ports.items()}
    element.content = [reference_xml(child) for child in node.children]
    return element


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
    world, now = World(spec), dict[str, bool]()

    def set_all() -> None:
        for name, value in now.items():
            if world.mission.entries.is_condition(name):
                world.set(name, value)

    def begin(step: int) -> None:
        story.set_by_sensors(now, step)
        set_all()

    def finish(request: Request, start: int, success: bool) -> Ours:
        sets = story.set_by(request.subject, start)
        ended = world.returns(request.activation, success, sets)
        now.update(sets)
        if ended is Ours.RUNNING:
            set_all()
        return ended

    return list(steps(world, STEPS, begin, story.end, finish))


def labelled(spec: NodeSpec) -> str:
    inside = ", ".join(labelled(child) for child in spec.children)
    kind = reference_kind(spec)[0] if spec.children else spec.subject
    limit = f" {spec.limit}/{spec.failures}" if spec.limit else ""
    return f"{kind}{limit}({inside})" if inside else kind
