"""A lifted tree ends as the single robot's does, or well where that one does not."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.analysis.lift.effects import Declarations
from mrbt_mesh.analysis.lift.lifter import Lifter
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec, Status
from mrbt_mesh.formats.declaration import Declaration
from tests.support.build import action, condition
from tests.support.single_robot_runs import run
from tests.support.single_robot_trees import VARIABLES, Grower


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


@pytest.mark.slow
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


def test_alternatives_that_act_on_the_world_are_tried_in_turn() -> None:
    """The paper's screwdrivers: both would tighten the one screw."""
    large, small = action("use_large_screwdriver"), action("use_small_screwdriver")
    spec = NodeSpec(Kind.FALLBACK, (large, small), "drive", memory=Memory.WHILE_RUNNING)
    tightens = Declaration(effects={"tight": True}, may_fail=True)
    declared = {large.subject: tightens, small.subject: tightens}
    lifted = Lifter(declared).lift(spec)
    assert lifted.tree == spec
    (decision,) = lifted.decisions
    assert decision.after == "use_large_screwdriver ; use_small_screwdriver"
    (why,) = decision.dependences
    assert why.reason.startswith(f"{large.subject} acts on the world, and only one of them")


def test_alternatives_that_only_look_are_tried_at_once() -> None:
    """The paper's storages: where the tools are found, nothing is changed."""
    spec = NodeSpec(Kind.FALLBACK, (A, B), memory=Memory.WHILE_RUNNING)
    looks = Declaration(may_fail=True)
    lifted = Lifter({"a": looks, "b": looks}).lift(spec)
    assert (lifted.tree.kind, lifted.tree.limit) == (Kind.PARALLEL, 1)


def test_alternatives_that_find_the_same_are_tried_at_once_where_somebody_says_so() -> None:
    spec = NodeSpec(Kind.FALLBACK, (A, B), "search", memory=Memory.WHILE_RUNNING)
    finds = Declaration(effects={"found": True}, may_fail=True)
    other = Declaration(effects={"elsewhere": True}, may_fail=True)
    assert Lifter({"a": finds, "b": finds}).lift(spec).tree == spec
    lifted = Lifter({"a": finds, "b": finds}, {}, ["search"]).lift(spec)
    assert (lifted.tree.kind, lifted.tree.limit) == (Kind.PARALLEL, 1)
    assert Lifter({"a": finds, "b": other}, {}, ["search"]).lift(spec).tree == spec


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
