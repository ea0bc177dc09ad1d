"""The statuses of the paper's section III, and those of the decorators."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.evaluation import Evaluation, PresentFacts
from mrbt_mesh.core.bt.evaluator import Evaluator, parallel_status
from mrbt_mesh.core.bt.tree import LEAVES, Kind, NodeSpec, Status, build_tree
from tests.support.build import (
    World,
    action,
    condition,
    fallback,
    inverter,
    leaves,
    parallel,
    sequence,
    timeout,
)
from tests.support.strategies import tree_specs

RUNNING, SUCCESS, FAILURE, IDLE = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.IDLE
RESULTS = (RUNNING, SUCCESS, FAILURE)
PLAIN = (Kind.INVERTER, Kind.FORCE_SUCCESS, Kind.FORCE_FAILURE, Kind.SUBTREE)
FLIPPED = {RUNNING: RUNNING, SUCCESS: FAILURE, FAILURE: SUCCESS}


@dataclass
class Given(PresentFacts):
    """Facts that fix the status of every leaf."""

    leaves: dict[str, Status]

    def condition(self, name: str) -> bool:
        return self.leaves[name] is SUCCESS

    def task_status(self, subject: str, activation: str) -> Status:
        return self.leaves[subject]


def evaluate(spec: NodeSpec, statuses: dict[str, Status]) -> Evaluation:
    return Evaluator(build_tree(spec)).evaluate(Given(statuses))


def paper(spec: NodeSpec, given_leaves: dict[str, Status]) -> Status:
    """The paper's section III, word for word."""
    if spec.kind in LEAVES:
        return given_leaves[spec.subject]
    children = [paper(child, given_leaves) for child in spec.children]
    if spec.kind is Kind.SEQUENCE:
        return next((status for status in children if status is not SUCCESS), SUCCESS)
    if spec.kind is Kind.FALLBACK:
        return next((status for status in children if status is not FAILURE), FAILURE)
    if spec.kind is Kind.PARALLEL:
        if children.count(SUCCESS) >= spec.limit:
            return SUCCESS
        hopeful = children.count(SUCCESS) + children.count(RUNNING)
        return FAILURE if hopeful < spec.limit else RUNNING
    if spec.kind is Kind.IF_THEN_ELSE:  # not the paper's, BehaviorTree.CPP's
        if children[0] is RUNNING:
            return RUNNING
        branch = 1 if children[0] is SUCCESS else 2
        return children[branch] if branch < len(children) else FAILURE
    if spec.kind is Kind.SUBTREE or children[0] is RUNNING:
        return children[0]
    if spec.kind is Kind.INVERTER:
        return FLIPPED[children[0]]
    return SUCCESS if spec.kind is Kind.FORCE_SUCCESS else FAILURE


@st.composite
def trees_with_statuses(draw: st.DrawFn) -> tuple[NodeSpec, dict[str, Status]]:
    spec = draw(tree_specs(PLAIN, max_leaves=12))
    statuses = {name: draw(st.sampled_from(RESULTS)) for name in leaves(spec, Kind.ACTION)}
    for name in leaves(spec, Kind.CONDITION):
        statuses[name] = draw(st.sampled_from((SUCCESS, FAILURE)))
    return spec, statuses


@given(trees_with_statuses())
def test_every_tree_has_the_status_that_the_paper_gives_it(
    case: tuple[NodeSpec, dict[str, Status]],
) -> None:
    spec, statuses = case
    assert evaluate(spec, statuses).status is paper(spec, statuses)


@given(trees_with_statuses())
def test_children_behind_the_deciding_one_are_not_ticked(
    case: tuple[NodeSpec, dict[str, Status]],
) -> None:
    spec, statuses = case
    tree = build_tree(spec)
    found = [Status(each) for each in evaluate(spec, statuses).statuses]
    passing = {Kind.SEQUENCE: SUCCESS, Kind.FALLBACK: FAILURE}
    assert found[0] is not IDLE
    for node in tree.nodes:
        ticked = [found[child] is not IDLE for child in node.children]
        if found[node.index] is IDLE:
            assert not any(ticked)
        elif node.kind in passing:
            reached = [found[child] is passing[node.kind] for child in node.children]
            count = reached.index(False) + 1 if False in reached else len(reached)
            assert ticked == [position < count for position in range(len(ticked))]
        elif node.kind is Kind.IF_THEN_ELSE:
            branch = {SUCCESS: 1, FAILURE: 2}.get(found[node.children[0]])
            assert ticked == [position in (0, branch) for position in range(len(ticked))]
        else:
            assert all(ticked)


@given(trees_with_statuses())
def test_only_running_actions_with_running_ancestors_request_anything(
    case: tuple[NodeSpec, dict[str, Status]],
) -> None:
    spec, statuses = case
    tree = build_tree(spec)
    evaluation = evaluate(spec, statuses)
    expected = []
    for node in tree.actions():
        line = [node.index]
        while tree.nodes[line[-1]].parent >= 0:
            line.append(tree.nodes[line[-1]].parent)
        if all(evaluation.status_of(index) is RUNNING for index in line):
            expected.append(node.index)
    assert [request.node for request in evaluation.requests] == expected


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_parallel_statuses_for_all_combinations_of_children(count: int) -> None:
    names = [f"a{number}" for number in range(count)]
    for needed in range(1, count + 1):
        spec = parallel(needed, *map(action, names))
        for statuses in itertools.product(RESULTS, repeat=count):
            chosen = dict(zip(names, statuses, strict=True))
            assert evaluate(spec, chosen).status is paper(spec, chosen), (needed, statuses)


def test_a_parallel_that_has_succeeded_requests_nothing_more() -> None:
    found = evaluate(parallel(1, action("a"), action("b")), {"a": SUCCESS, "b": RUNNING})
    assert (found.status, found.requests) == (SUCCESS, ())


def test_requests_come_in_tree_order() -> None:
    world = World(parallel(3, action("z"), sequence(action("m"), action("n")), action("a")))
    assert world.asked() == ["z", "m", "a"]


class TestTimeout:
    def test_a_running_child_is_watched_and_fails_once_the_deadline_was_seen_to_pass(self) -> None:
        world = World(timeout(2, action("a")))
        (watched,) = world.tick().timeouts
        assert watched.timeout_us == 2_000_000
        assert world.asked() == ["a"]
        world.expire()
        assert world.status is FAILURE
        assert world.asked() == []
        assert world.tick().timeouts == ()

    def test_a_child_that_has_finished_is_not_watched(self) -> None:
        world = World(timeout(2, action("a")))
        world.succeed("a")
        assert world.status is SUCCESS
        assert world.tick().timeouts == ()

    def test_a_child_that_was_in_time_stays_so(self) -> None:
        world = World(sequence(timeout(2, action("a")), action("b")))
        scope = world.tick().timeouts[0].activation
        world.succeed("a")
        world.write("R1", (f"expired/{scope}", True))
        assert world.asked() == ["b"]

    def test_a_timeout_inside_a_finished_node_is_not_watched(self) -> None:
        world = World(parallel(1, timeout(2, action("a")), action("b")))
        assert len(world.tick().timeouts) == 1
        world.succeed("b")
        assert world.tick().timeouts == ()

    def test_the_next_round_gets_the_whole_time_again(self) -> None:
        world = World(sequence(condition("c"), timeout(2, action("a"))), true_at_first=["c"])
        first = world.tick().timeouts[0].activation
        world.expire()
        world.set("c", False)
        world.set("c", True)
        (again,) = world.tick().timeouts
        assert again.activation != first
        assert world.asked() == ["a"]

    def test_under_a_fallback_the_next_child_gets_its_turn(self) -> None:
        world = World(fallback(timeout(2, action("a")), action("b")))
        world.expire()
        assert world.asked() == ["b"]


def test_an_inverted_timeout_succeeds_when_it_expires() -> None:
    world = World(inverter(timeout(1, action("a"))))
    world.expire()
    assert world.status is SUCCESS


def test_a_parallel_may_fail_at_fewer_failures_and_its_children_count_in_their_order() -> None:
    won, lost, runs = Status.SUCCESS, Status.FAILURE, Status.RUNNING
    assert parallel_status([lost, runs, runs], 1) is runs
    assert parallel_status([lost, runs, runs], 1, 1) is lost
    assert parallel_status([lost, won, runs], 1, 1) is lost
    assert parallel_status([won, lost, runs], 1, 1) is won
    assert parallel_status([lost, runs, won], 2, 2) is runs
