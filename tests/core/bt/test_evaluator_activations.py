"""Activations: what is done once, what is done anew, and what stragglers may not do."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.activation import Activation, parse_activation
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from tests.support.build import (
    World,
    action,
    condition,
    decorated,
    fallback,
    inverter,
    keep_running,
    parallel,
    refusal,
    repeat,
    retry,
    sequence,
)
from tests.support.strategies import Run, runs

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE
A, B, X, Z = map(action, "abxz")


# -- the golden cases of docs/decisions/0002 ---------------------------------------------------


@pytest.mark.parametrize("is_given", [True, False])
def test_golden_case_1_a_late_success_does_not_run_the_dose_again(is_given: bool) -> None:
    world = World(sequence(fallback(A, B), action("dose")))
    late = world.activation("a")
    world.fail("a")
    world.succeed("b")
    dose = world.activation("dose")
    if is_given:
        world.succeed("dose")
    world.outcome(late, True, robot="R2")
    if is_given:
        assert (world.status, world.asked()) == (SUCCESS, [])
    else:
        assert world.activation("dose") == dose


def test_golden_case_2_a_straggler_of_a_parallel_does_not_restart_what_follows() -> None:
    world = World(sequence(parallel(1, X, sequence(action("y1"), action("y2"))), Z))
    straggler = world.activation("y1")
    world.succeed("x")
    z = world.activation("z")
    world.outcome(straggler, True, robot="R2")
    assert world.activation("z") == z
    assert world.asked() == ["z"]


def test_golden_case_3_a_guard_that_turns_back_has_the_work_done_anew() -> None:
    world = World(sequence(fallback(condition("c"), A), B))
    first_a = world.activation("a")
    world.succeed("a")
    first_b = world.activation("b")
    world.set("c", True)
    assert world.activation("b") == first_b, "a guard that turns in favour changes nothing"
    world.set("c", False)
    assert world.asked() == ["a"]
    assert world.activation("a") != first_a
    world.succeed("a")
    assert world.asked() == ["b"]
    assert world.activation("b") != first_b


# -- guards -----------------------------------------------------------------------------------


def flip(world: World, name: str = "c", times: int = 2) -> None:
    for _ in range(times):
        world.set(name, not world.facts.condition(name))


def renewed(spec: NodeSpec, subject: str, true_at_first: list[str], name: str = "c") -> bool:
    """Whether a subject has a new activation after a condition flipped and flipped back."""
    world = World(spec, true_at_first)
    before = world.activation(subject)
    flip(world, name)
    return world.activation(subject) != before


DEEP = sequence(condition("c"), parallel(2, fallback(condition("d"), A), B))


@pytest.mark.parametrize(
    ("spec", "subject", "true_at_first", "name", "expected"),
    [
        # In a Sequence guards turn by becoming false, in a Fallback by becoming true.
        (sequence(condition("c"), A), "a", ["c"], "c", True),
        (fallback(condition("c"), A), "a", [], "c", True),
        (sequence(inverter(condition("c")), A), "a", [], "c", True),
        (fallback(inverter(condition("c")), A), "a", ["c"], "c", True),
        (inverter(sequence(condition("c"), A)), "a", ["c"], "c", True),
        # Siblings in a Parallel, or further right, are no guards.
        (parallel(1, condition("c"), A), "a", [], "c", False),
        (parallel(2, condition("c"), A, B), "b", ["c"], "c", False),
        (sequence(A, condition("c"), B), "a", ["c"], "c", False),
        # Guards reach down through every level.
        (DEEP, "a", ["c"], "c", True),
        (DEEP, "b", ["c"], "c", True),
        (DEEP, "a", ["c"], "d", True),
        (DEEP, "b", ["c"], "d", False),
        (sequence(sequence(condition("d"), condition("c")), A), "a", ["c", "d"], "c", True),
        # c is read only while d is false, so not by every evaluation.
        (sequence(fallback(condition("d"), condition("c")), A), "a", ["c", "d"], "c", False),
        (sequence(decorated(Kind.FORCE_SUCCESS, condition("c")), A), "a", [], "c", False),
    ],
)
def test_which_conditions_guard_an_action(
    spec: NodeSpec, subject: str, true_at_first: list[str], name: str, expected: bool
) -> None:
    assert renewed(spec, subject, true_at_first, name) is expected


def test_a_guard_under_an_inverter_stops_the_action_while_it_holds() -> None:
    world = World(sequence(inverter(condition("c")), A))
    before = world.activation("a")
    world.set("c", True)
    assert world.status is FAILURE
    assert world.asked() == []
    world.set("c", False)
    after = world.activation("a")
    assert parse_activation(after).turns == parse_activation(before).turns + 1


def test_one_turn_is_counted_once_however_deep_the_inverters_are() -> None:
    world = World(sequence(inverter(inverter(condition("c"))), A), true_at_first=["c"])
    flip(world)
    assert parse_activation(world.activation("a")).turns == 1


def test_a_guard_that_flips_while_the_work_runs_has_it_started_anew() -> None:
    world = World(sequence(condition("c"), A), true_at_first=["c"])
    stale = world.activation("a")
    flip(world)
    world.outcome(stale, True)
    assert world.asked() == ["a"], "the outcome belongs to the work that was given up"
    world.succeed("a")
    assert world.status is SUCCESS


def test_a_maintained_state_is_repaired_again_at_every_breakdown() -> None:
    world = World(fallback(condition("nominal"), sequence(A, B)), true_at_first=["nominal"])
    seen = set()
    for _ in range(3):
        assert world.status is SUCCESS
        world.set("nominal", False)
        for subject in ("a", "b"):
            assert world.asked() == [subject]
            seen.add(world.activation(subject))
            world.succeed(subject)
        world.set("nominal", True)
    assert len(seen) == 6


# -- Retry, Repeat, KeepRunningUntilFailure ---------------------------------------------------


@pytest.mark.parametrize(
    ("spec", "outcomes", "statuses"),
    [
        (retry(3, A), "fff", "rrf"),
        (retry(3, A), "fs", "rs"),
        (retry(-1, A), "ffffs", "rrrrs"),
        (repeat(2, A), "ss", "rs"),
        (repeat(2, A), "sf", "rf"),
        (repeat(-1, A), "ssssf", "rrrrf"),
        (keep_running(A), "ssssf", "rrrrf"),
    ],
)
def test_the_status_of_a_loop_after_each_outcome(
    spec: NodeSpec, outcomes: str, statuses: str
) -> None:
    world, found, seen = World(spec), "", set()
    for outcome in outcomes:
        seen.add(world.activation("a"))
        world.outcome(world.activation("a"), outcome == "s")
        found += world.status.name[0].lower()
    assert found == statuses
    assert len(seen) == len(outcomes), "each attempt has an activation of its own"


def test_a_condition_alone_uses_up_no_attempt() -> None:
    world = World(retry(2, sequence(condition("c"), A)))
    flip(world, times=7)
    assert parse_activation(world.activation("a")).attempts == (0,)


@pytest.mark.parametrize(
    ("spec", "status_if_false", "status_if_true"),
    [
        # A node with a limit takes the status of its child, one without waits.
        (retry(3, condition("c")), FAILURE, SUCCESS),
        (repeat(3, condition("c")), FAILURE, SUCCESS),
        (retry(-1, condition("c")), RUNNING, SUCCESS),
        (repeat(-1, condition("c")), FAILURE, RUNNING),
        (keep_running(condition("c")), FAILURE, RUNNING),
    ],
)
def test_loops_where_conditions_alone_decide(
    spec: NodeSpec, status_if_false: Status, status_if_true: Status
) -> None:
    world = World(spec)
    assert world.status is status_if_false
    world.set("c", True)
    assert world.status is status_if_true


def test_used_attempts_are_latched_and_outlive_the_outcomes() -> None:
    world = World(retry(5, sequence(A, B)))
    for _ in range(2):
        world.succeed("a")
        world.fail("b")
        world.tick()
    dropped = world.facts.prune()
    assert dropped
    assert not any(said.outcomes for said in world.facts.activations.values())
    assert parse_activation(world.activation("a")).attempts == (2,)


def test_the_failure_of_a_used_attempt_needs_no_latch_and_that_of_the_last_one_does() -> None:
    world = World(retry(2, A))
    first = world.activation("a")
    world.fail("a")
    assert world.evaluator.evaluate(world.facts).failures == ()
    last = world.activation("a")
    world.fail("a")
    assert world.evaluator.evaluate(world.facts).failures == (last,)
    assert world.status is FAILURE
    assert not world.facts.has_latched_failure(first)


def test_every_outer_attempt_has_its_own_inner_attempts() -> None:
    world = World(retry(2, repeat(2, A)))
    names = []
    for success in (True, False, True, True):
        names.append(parse_activation(world.activation("a")).attempts)
        world.outcome(world.activation("a"), success)
    assert names == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert world.status is SUCCESS


def test_a_late_success_of_a_used_attempt_does_not_count_for_the_next_one() -> None:
    world = World(retry(3, A))
    late = world.activation("a")
    world.fail("a")
    assert world.status is RUNNING
    world.outcome(late, True, robot="R2")
    assert world.asked() == ["a"]


@pytest.mark.parametrize(("loop", "status"), [(retry, FAILURE), (repeat, SUCCESS)])
@pytest.mark.parametrize("used", [2, 7])
def test_a_loop_that_has_used_up_its_attempts_has_ended(
    loop: Callable[[int, NodeSpec], NodeSpec], status: Status, used: int
) -> None:
    """A revision has given it fewer; with more of them again, it would go on."""
    world = World(loop(2, A))
    scope = str(Activation("r1", 0, "", (), 0))
    beyond = parse_entry("R9", f"attempt/{scope}", Version(Incarnation(1, "n"), 1), used)
    assert refusal(world.facts, beyond) == f"'{scope}' has no attempt {used}"
    world.facts.map.merge([beyond])  # as it stands after a revision
    assert world.tick().status is status
    assert not world.asked()
    last = Activation("r1", 1, "a", (1,), 0)
    assert not world.evaluator.is_obsolete(last, world.facts)


def test_a_name_that_is_ahead_of_the_facts_is_not_obsolete() -> None:
    world = World(sequence(condition("c"), retry(5, A)), true_at_first=["c"])
    world.fail("a")
    world.fail("a")
    world.tick()
    # The guard turned and the attempts began again, but these facts have not heard of it yet.
    ahead = parse_activation("r1:3:a:0:1")
    assert not world.evaluator.is_obsolete(ahead, world.facts)
    flip(world)
    assert world.activation("a") == str(ahead)
    assert world.evaluator.is_obsolete(parse_activation("r1:3:a:4:0"), world.facts)


# -- names ------------------------------------------------------------------------------------


@given(
    st.builds(
        Activation,
        st.sampled_from(("r1", "2024-x")),
        st.integers(0, 99),
        st.sampled_from(("", "fix(2)")),
        st.lists(st.integers(0, 9), max_size=3).map(tuple),
        st.integers(0, 99),
        st.sampled_from(("", "morning-1")),
    )
)
def test_names_of_activations_can_be_read_back(name: Activation) -> None:
    assert parse_activation(str(name)) == name


@pytest.mark.parametrize("text", ["", "r1:0:a:0", "r1:x:a::0", "r1:0:a:0.y:0", "r1:0:a:::0"])
def test_what_names_no_activation_is_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match=r"invalid literal|unpack"):
        parse_activation(text)


def test_names_are_derived_from_causes_alone() -> None:
    world = World(sequence(condition("c"), retry(-1, A)), true_at_first=["c"])
    world.fail("a")
    flip(world)
    world.fail("a")
    world.fail("a")
    assert world.activation("a") == "r1:3:a:2:1"


# -- properties of whole runs -----------------------------------------------------------------


@given(runs())
def test_requests_are_running_actions_with_a_name_of_their_own(run: Run) -> None:
    evaluation = run.world.tick()
    names = [request.activation for request in evaluation.requests]
    assert len(names) == len(set(names))
    for request in evaluation.requests:
        assert evaluation.status_of(request.node) is RUNNING
        assert run.world.facts.task_status(request.subject, request.activation) is RUNNING
    if evaluation.status is not RUNNING:
        assert not evaluation.requests
        assert not evaluation.timeouts


@given(runs(), st.randoms(use_true_random=False))
def test_the_order_in_which_facts_arrived_makes_no_difference(run: Run, random: object) -> None:
    entries = list(run.world.entries)
    random.shuffle(entries)  # type: ignore[attr-defined]
    other = run.world.replayed(entries + entries[:5])
    assert other.evaluator.evaluate(other.facts) == run.world.tick()


@given(runs())
def test_what_is_requested_is_never_obsolete(run: Run) -> None:
    world = run.world
    for request in world.tick().requests:
        assert not world.evaluator.is_obsolete(parse_activation(request.activation), world.facts)


@given(runs(), st.randoms(use_true_random=False))
def test_once_obsolete_always_obsolete_whatever_arrives_in_whatever_order(
    run: Run, random: object
) -> None:
    entries = list(run.world.entries)
    random.shuffle(entries)  # type: ignore[attr-defined]
    other = run.world.replayed([])
    names = [parse_activation(activation) for activation in run.seen]
    obsolete: set[Activation] = set()
    for entry in entries:
        other.facts.map.merge([entry])
        now = {name for name in names if other.evaluator.is_obsolete(name, other.facts)}
        assert obsolete <= now
        obsolete = now


@given(runs())
def test_dropping_what_is_obsolete_changes_no_evaluation(run: Run) -> None:
    before = run.world.evaluator.evaluate(run.world.facts)
    run.world.facts.prune()
    assert run.world.evaluator.evaluate(run.world.facts) == before
