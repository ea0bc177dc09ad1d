"""Random trees and random runs for the property tests."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import CONTROLS, Kind, Memory, NodeSpec
from tests.support.build import World, action, make_mission, parallel, task

CONDITIONS = ("c0", "c1", "c2")
UNARY = (
    Kind.INVERTER,
    Kind.FORCE_SUCCESS,
    Kind.FORCE_FAILURE,
    Kind.RETRY,
    Kind.REPEAT,
    Kind.TIMEOUT,
    Kind.KEEP_RUNNING_UNTIL_FAILURE,
    Kind.SUBTREE,
)


def _control(kind: Kind, children: tuple[NodeSpec, ...], needed: int, memory: Memory) -> NodeSpec:
    if kind is Kind.IF_THEN_ELSE and len(children) == 1:
        kind = Kind.SEQUENCE
    if memory is Memory.UNTIL_SUCCESS and kind is not Kind.SEQUENCE:
        memory = Memory.WHILE_RUNNING
    limit = 1 + needed % len(children) if kind is Kind.PARALLEL else 0
    return NodeSpec(kind, children, limit=limit, memory=memory)


def _unary(kind: Kind, child: NodeSpec, limit: int) -> NodeSpec:
    return NodeSpec(
        kind,
        (child,),
        limit=limit if kind in (Kind.RETRY, Kind.REPEAT) else 0,
        timeout_us=1_000_000 if kind is Kind.TIMEOUT else 0,
    )


def _numbered(spec: NodeSpec, counter: list[int]) -> NodeSpec:
    """Give every action a name of its own."""
    if spec.kind is Kind.ACTION:
        counter[0] += 1
        return NodeSpec(Kind.ACTION, subject=f"a{counter[0]}")
    children = tuple(_numbered(child, counter) for child in spec.children)
    return replace(spec, children=children)


def tree_specs(unary: tuple[Kind, ...] = UNARY, max_leaves: int = 8) -> st.SearchStrategy[NodeSpec]:
    """Trees of all node kinds; every action has a name of its own, conditions repeat."""
    leaf = st.one_of(
        st.just(NodeSpec(Kind.ACTION, subject="a")),
        st.sampled_from(CONDITIONS).map(lambda name: NodeSpec(Kind.CONDITION, subject=name)),
    )

    def grow(inner: st.SearchStrategy[NodeSpec]) -> st.SearchStrategy[NodeSpec]:
        controls = st.builds(
            _control,
            st.sampled_from(sorted(CONTROLS)),
            st.lists(inner, min_size=1, max_size=3).map(tuple),
            st.integers(0, 2),
            st.sampled_from(Memory),
        )
        limits = st.sampled_from((-1, 1, 2, 3))
        return controls | st.builds(_unary, st.sampled_from(unary), inner, limits)

    trees = st.recursive(leaf, grow, max_leaves=max_leaves)
    return trees.map(lambda spec: _numbered(spec, [0]))


class Run:
    """A random run of a tree: conditions flip, requested and stale activations end."""

    def __init__(self, spec: NodeSpec) -> None:
        self.world = World(spec)
        self.seen: list[str] = []
        self.note()

    def note(self) -> None:
        for request in self.world.tick().requests:
            if request.activation not in self.seen:
                self.seen.append(request.activation)

    def step(self, choice: int, success: bool) -> None:
        """One thing happens, and what follows is written down."""
        self.happen(choice, success)
        self.note()

    def happen(self, choice: int, success: bool) -> None:
        """One thing happens, named by a number."""
        world = self.world
        conditions = sorted(world.mission.conditions)
        if choice % 3 == 0 and conditions:
            name = conditions[choice // 3 % len(conditions)]
            world.set(name, not world.facts.condition(name))
        elif choice % 7 == 1:
            world.expire()
        elif self.seen:
            # Mostly what was asked for last; sometimes a straggler.
            position = max(0, len(self.seen) - 1 - choice // 3 % 6)
            world.outcome(self.seen[position], success)


STEPS = st.lists(st.tuples(st.integers(0, 60), st.booleans()), max_size=25)


@st.composite
def runs(draw: st.DrawFn) -> Run:
    """A tree with a history."""
    run = Run(draw(tree_specs()))
    for choice, success in draw(STEPS):
        run.step(choice, success)
    return run


@st.composite
def worlds(draw: st.DrawFn) -> World:
    """A few requests, a few robots with some of the capabilities."""
    kinds = ("lift", "look", "weld")
    tasks = []
    for number in range(draw(st.integers(1, 4))):
        chosen = draw(st.lists(st.sampled_from(kinds), min_size=1, max_size=2, unique=True))
        least = draw(st.lists(st.integers(0, 2), min_size=len(chosen), max_size=len(chosen)))
        least[0] = max(1, least[0])
        needs = [(kind, low, 3) for kind, low in zip(chosen, least, strict=True)]
        tasks.append(task(f"t{number}", *needs))
    can = st.lists(st.sampled_from(kinds), max_size=3, unique=True)
    robots = {f"r{i}": dict.fromkeys(draw(can), 1.0) for i in range(draw(st.integers(0, 5)))}
    tree = parallel(len(tasks), *(action(each.id) for each in tasks))
    return World(make_mission(tree, robots, tasks))
