"""A lifted tree ends as the single robot's does, or well where that one does not."""

from __future__ import annotations

import random
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.analysis.effects import Declarations
from mrbt_mesh.analysis.lift import Lifter, child_path, root_path, walk
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec, Status, build_tree
from mrbt_mesh.formats.declaration import Declaration
from tests.support.build import World, action, condition

VARIABLES = ("v0", "v1", "v2", "v3", "v4", "v5")
REST = ("x0", "x1", "x2")  # what actions read and write besides conditions
MOST_ACTIONS = 60


# -- random single-robot trees ----------------------------------------------------------------


@dataclass
class Grower:
    """A random tree of actions that declare what they do."""

    random: random.Random
    declared: dict[str, Declaration] = field(default_factory=dict)

    def tree(self, depth: int = 3) -> NodeSpec:
        roll = self.random.random()
        if depth == 0 or roll < 0.15:
            return self._leaf()
        if roll < 0.25:
            kind = self.random.choice(
                (Kind.INVERTER, Kind.FORCE_SUCCESS, Kind.RETRY, Kind.SUBTREE, Kind.REPEAT)
            )
            limit = 2 if kind in (Kind.RETRY, Kind.REPEAT) else 0
            return NodeSpec(kind, (self.tree(depth - 1),), limit=limit)
        if roll < 0.32:
            children = tuple(self.tree(depth - 1) for _ in range(self.random.randint(2, 3)))
            return NodeSpec(Kind.IF_THEN_ELSE, children, memory=self._memory())
        kind = Kind.SEQUENCE if self.random.random() < 0.65 else Kind.FALLBACK
        children = tuple(self.tree(depth - 1) for _ in range(self.random.randint(2, 4)))
        return NodeSpec(kind, children, memory=self._memory())

    def _memory(self) -> Memory:
        return self.random.choice((Memory.NONE, Memory.WHILE_RUNNING))

    def _some(self, names: tuple[str, ...], most: int) -> list[str]:
        return self.random.sample(names, self.random.choice([0, 0, *range(most + 1)]))

    def _leaf(self) -> NodeSpec:
        if self.random.random() < 0.2:
            return condition(self.random.choice(VARIABLES))
        name = f"a{len(self.declared)}"
        self.declared[name] = Declaration(
            reads=frozenset(self._some(REST, 1)),
            writes=frozenset(self._some(REST, 1)),
            uses=frozenset(self._some(("arm",), 1)) if self.random.random() < 0.2 else frozenset(),
            requires={v: self.random.random() < 0.7 for v in self._some(VARIABLES, 1)},
            effects={v: self.random.random() < 0.7 for v in self._some(VARIABLES, 2)},
            may_fail=self.random.random() < 0.15,
        )
        return action(name)


# -- runs -------------------------------------------------------------------------------------


@dataclass
class Field:
    """What actions do to the world. What one writes tells what it read, and who wrote it."""

    declared: Declarations
    seed: int
    start: Mapping[str, bool]

    def __post_init__(self) -> None:
        self.rest: dict[str, int] = dict.fromkeys(REST, 0)

    def begin(self, name: str, world: World) -> tuple[bool, dict[str, int]]:
        """How the action will end, by what it finds: success, and what it will write."""
        does = self.declared[name]
        able = all(world.facts.condition(v) is value for v, value in does.requires.items())
        unlucky = does.may_fail and random.Random(f"{self.seed}/{name}").random() < 0.5
        read = sorted((x, self.rest[x]) for x in does.reads)
        written = {x: zlib.crc32(repr((name, x, read)).encode()) for x in does.writes}
        return able and not unlucky, written

    def end(
        self, activation: str, name: str, begun: tuple[bool, dict[str, int]], world: World
    ) -> None:
        success, written = begun
        if success:
            self.rest |= written
            for variable, value in self.declared[name].effects.items():
                if world.mission.knows_condition(variable):
                    world.set(variable, value)
        world.outcome(activation, success)

    def state(self, world: World) -> dict[str, object]:
        known = [v for v in VARIABLES if world.mission.knows_condition(v)]
        return {v: world.facts.condition(v) for v in known} | self.rest


@dataclass(frozen=True)
class Ended:
    """How a run ended, and the most actions that were going on at the same time."""

    status: Status
    state: dict[str, object]
    at_once: int = field(compare=False)


def run(
    spec: NodeSpec, declared: Declarations, start: Mapping[str, bool], seed: int, robots: int
) -> Ended | None:
    """One run with so many robots; None if it does not come to an end."""
    world = World(spec, [name for name, value in start.items() if value])
    place, source = Field(declared, seed, start), random.Random(f"run/{seed}/{robots}")
    running: dict[str, tuple[str, tuple[bool, dict[str, int]]]] = {}
    at_once = 0
    for _ in range(MOST_ACTIONS * 4):
        asked = {r.activation: r.subject for r in world.tick().requests}
        running = {a: begun for a, begun in running.items() if a in asked}
        waiting = [a for a in asked if a not in running]
        if world.status is not Status.RUNNING:
            return Ended(world.status, place.state(world), at_once)
        if waiting and len(running) < robots and (not running or source.random() < 0.7):
            activation = waiting[0] if robots == 1 else source.choice(waiting)
            running[activation] = asked[activation], place.begin(asked[activation], world)
            at_once = max(at_once, len(running))
        else:
            activation = source.choice(sorted(running))
            name, begun = running.pop(activation)
            place.end(activation, name, begun, world)
    return None


def single_and_team(seed: int) -> tuple[NodeSpec, NodeSpec, Declarations, dict[str, bool]]:
    source = random.Random(f"lift/{seed}")
    grower = Grower(source)
    spec = grower.tree()
    # Every condition that an action sets is one that the tree knows.
    known = Kind.FORCE_SUCCESS
    asks = NodeSpec(known, (NodeSpec(Kind.SEQUENCE, tuple(condition(v) for v in VARIABLES)),))
    spec = NodeSpec(Kind.SEQUENCE, (asks, spec), memory=Memory.WHILE_RUNNING)
    lifted = Lifter(grower.declared).lift(spec)
    start = {v: source.random() < 0.5 for v in VARIABLES}
    return spec, lifted.tree, grower.declared, start


def check(seed: int) -> bool:
    """Whether the team does anything at the same time that the single tree does not."""
    spec, team, declared, start = single_and_team(seed)
    alone = run(spec, declared, start, seed, robots=1)
    if alone is None:
        return False
    at_once = 0
    for robots in (1, 2, 5):
        for _ in range(2):
            found = run(team, declared, start, seed, robots)
            wins = found is not None and alone.status is Status.FAILURE
            wins = wins and found.status is Status.SUCCESS
            assert found == alone or wins, f"seed {seed}, {robots} robots: {alone} became {found}"
            at_once = max(at_once, found.at_once)
    return at_once > 1


@settings(max_examples=60)
@given(st.integers(0, 10_000_000))
def test_any_run_of_the_lifted_tree_ends_as_the_single_robots(seed: int) -> None:
    check(seed)


def test_of_many_trees_some_are_parallelised_and_none_ends_otherwise() -> None:
    assert sum(map(check, range(200))) >= 60


@pytest.mark.parametrize("rule", ["_conflict", "_order_by_failures"])
def test_without_one_of_its_rules_a_lift_goes_wrong(
    rule: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So the tests above would notice."""
    monkeypatch.setattr(Lifter, rule, lambda *_: None)

    def check_all() -> None:
        for seed in range(400):
            check(seed)

    with pytest.raises(AssertionError, match="became"):
        check_all()


# -- single cases -----------------------------------------------------------------------------


def sequence(*children: NodeSpec, name: str = "") -> NodeSpec:
    return NodeSpec(Kind.SEQUENCE, children, name, memory=Memory.WHILE_RUNNING)


def arranged(spec: NodeSpec, declared: Declarations, *independent: str) -> str:
    """The arrangement of the root's children."""
    return Lifter(declared, {}, independent).lift(spec).decisions[0].after


A, B, C = map(action, "abc")
PURE = Declaration()


def test_without_declarations_nothing_is_parallelised() -> None:
    lifted = Lifter({"a": PURE, "c": PURE}).lift(sequence(A, B, C))
    assert lifted.tree == sequence(A, B, C)
    (decision,) = lifted.decisions
    assert decision.after == "a ; b ; c"
    assert {d.reason for d in decision.dependences} == {"b declares nothing"}


def test_what_is_said_to_be_independent_is() -> None:
    spec = sequence(A, B, C, name="all")
    assert arranged(spec, {}, "all") == "a | b | c"
    declared = {"a": Declaration(writes=frozenset({"x"})), "b": Declaration(reads=frozenset({"x"}))}
    assert arranged(spec, declared, "all") == "(a ; b) | c"


def test_one_resource_is_shared_in_turn() -> None:
    arm = Declaration(uses=frozenset({"arm"}))
    assert arranged(sequence(A, B, C), {"a": arm, "b": PURE, "c": arm}) == "(a ; c) | b"


def test_an_action_that_may_fail_is_waited_for_by_what_changes_something() -> None:
    changes = Declaration(writes=frozenset({"x"}))
    fails = Declaration(may_fail=True)
    assert arranged(sequence(A, B), {"a": fails, "b": changes}) == "a ; b"
    assert arranged(sequence(A, B), {"a": fails, "b": PURE}) == "a | b"


def test_what_makes_sure_of_a_requirement_comes_before() -> None:
    opens = Declaration(effects={"open": True})
    enters = Declaration(requires={"open": True}, effects={"inside": True})
    lights = Declaration(effects={"light": True})
    declared = {"a": opens, "b": lights, "c": enters}
    assert arranged(sequence(A, B, C), declared) == "(a ; c) | b"


def test_alternatives_are_tried_at_once_only_if_they_change_the_same() -> None:
    spec = NodeSpec(Kind.FALLBACK, (A, B), memory=Memory.WHILE_RUNNING)
    same = Declaration(effects={"done": True}, may_fail=True)
    other = Declaration(effects={"elsewhere": True}, may_fail=True)
    lifted = Lifter({"a": same, "b": same}).lift(spec)
    assert (lifted.tree.kind, lifted.tree.limit) == (Kind.PARALLEL, 1)
    assert Lifter({"a": same, "b": other}).lift(spec).tree == spec


def test_what_is_nested_is_taken_apart_where_that_is_faster() -> None:
    looks = {f"look{k}": Declaration(effects={f"seen{k}": True}) for k in (1, 2)}
    fixes = {f"fix{k}": Declaration(requires={f"seen{k}": True}) for k in (1, 2)}
    work_us = {"look1": 1, "look2": 9, "fix1": 9, "fix2": 1}
    spec = sequence(
        sequence(action("look1"), action("look2")), sequence(action("fix1"), action("fix2"))
    )
    lifted = Lifter({**looks, **fixes}, work_us).lift(spec)
    assert lifted.decisions[0].after == "(look1 ; fix1) | (look2 ; fix2)"
    assert (lifted.serial_us, lifted.critical_us) == (20, 10)
    kept = Lifter({**looks, **fixes}, dict.fromkeys(work_us, 5)).lift(spec)
    assert kept.decisions[0].after == "Sequence(look1 ...) ; Sequence(fix1 ...)"


def test_below_a_timeout_everything_stays() -> None:
    inner = sequence(A, B)
    spec = NodeSpec(Kind.TIMEOUT, (inner,), timeout_us=5_000_000)
    assert Lifter({"a": PURE, "b": PURE}).lift(spec).tree == spec


@pytest.mark.parametrize("seed", range(20))
def test_a_walk_places_every_node_of_a_tree_in_preorder(seed: int) -> None:
    tree = Grower(random.Random(seed)).tree()
    nodes = list(walk(tree))
    assert [node.spec.kind for node in nodes] == [node.kind for node in build_tree(tree).nodes]
    assert [node.place for node in nodes] == sorted(node.place for node in nodes)
    for node in nodes:
        spec, path = tree, root_path(tree)
        for position in node.place:
            spec, path = spec.children[position], child_path(path, spec, position)
        assert (spec, path) == (node.spec, node.path)
