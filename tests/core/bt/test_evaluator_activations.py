"""Activations: what is done once, what is done anew, and what stragglers may not do."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.activation import Activation, parse_activation
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status
from tests.support.build import (
    World,
    action,
    condition,
    decorated,
    fallback,
    inverter,
    keep_running,
    parallel,
    repeat,
    retry,
    sequence,
)
from tests.support.strategies import Run, runs

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE
A, B, C, X, Y, Z = map(action, "abcxyz")


# -- the golden cases of docs/decisions/0002 ---------------------------------------------------


def test_golden_case_1_a_late_success_does_not_run_the_dose_again() -> None:
    world = World(sequence(fallback(A, B), action("dose")))
    late = world.activation("a")
    world.fail("a")
    world.succeed("b")
    world.succeed("dose")
    assert world.status is SUCCESS
    world.outcome(late, True, robot="R2")
    assert world.status is SUCCESS
    assert world.asked() == []


def test_golden_case_1_holds_while_the_dose_is_being_given() -> None:
    world = World(sequence(fallback(A, B), action("dose")))
    late = world.activation("a")
    world.fail("a")
    world.succeed("b")
    dose = world.activation("dose")
    world.outcome(late, True, robot="R2")
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


def test_guards_in_a_sequence_turn_by_becoming_false() -> None:
    assert renewed(sequence(condition("c"), A), "a", ["c"])


def test_guards_in_a_fallback_turn_by_becoming_true() -> None:
    assert renewed(fallback(condition("c"), A), "a", [])


def test_guards_under_an_inverter_turn_the_other_way_round() -> None:
    assert renewed(sequence(inverter(condition("c")), A), "a", [])
    assert renewed(fallback(inverter(condition("c")), A), "a", ["c"])
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


def test_an_inverter_around_guard_and_work_leaves_the_guard_as_it_is() -> None:
    world = World(inverter(sequence(condition("c"), A)), true_at_first=["c"])
    before = world.activation("a")
    world.set("c", False)
    assert world.status is SUCCESS
    world.set("c", True)
    assert world.activation("a") != before


def test_siblings_in_a_parallel_are_no_guards_of_one_another() -> None:
    assert not renewed(parallel(1, condition("c"), A), "a", [])
    assert not renewed(parallel(2, condition("c"), A, B), "b", ["c"])


def test_siblings_further_right_are_no_guards() -> None:
    assert not renewed(sequence(A, condition("c"), B), "a", ["c"])


def test_guards_reach_down_through_every_level() -> None:
    spec = sequence(condition("c"), parallel(2, fallback(condition("d"), A), B))
    assert renewed(spec, "a", ["c"])
    assert renewed(spec, "b", ["c"])
    assert renewed(spec, "a", ["c"], name="d")
    assert not renewed(spec, "b", ["c"], name="d")


def test_nested_sequences_guard_as_if_they_were_written_out() -> None:
    assert renewed(sequence(sequence(condition("d"), condition("c")), A), "a", ["c", "d"])


def test_behind_a_condition_that_may_not_be_read_nothing_is_a_guard() -> None:
    # c is read only while d is false, so not by every evaluation.
    spec = sequence(fallback(condition("d"), condition("c")), A)
    world = World(spec, true_at_first=["c", "d"])
    before = world.activation("a")
    flip(world, "c")
    assert world.activation("a") == before


def test_a_forced_result_turns_against_nobody() -> None:
    forced = decorated(Kind.FORCE_SUCCESS, condition("c"))
    assert not renewed(sequence(forced, A), "a", [])


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


def test_retry_tries_as_often_as_it_may_and_then_fails() -> None:
    world = World(retry(3, A))
    seen = set()
    for _ in range(3):
        assert world.status is RUNNING
        seen.add(world.activation("a"))
        world.fail("a")
    assert world.status is FAILURE
    assert len(seen) == 3


def test_retry_succeeds_with_the_first_success() -> None:
    world = World(retry(3, A))
    world.fail("a")
    world.succeed("a")
    assert world.status is SUCCESS


def test_repeat_succeeds_after_that_many_successes_and_fails_with_the_first_failure() -> None:
    world = World(repeat(2, A))
    world.succeed("a")
    assert world.status is RUNNING
    world.succeed("a")
    assert world.status is SUCCESS
    other = World(repeat(2, A))
    other.succeed("a")
    other.fail("a")
    assert other.status is FAILURE


@pytest.mark.parametrize("kind", [Kind.REPEAT, Kind.KEEP_RUNNING_UNTIL_FAILURE])
def test_a_cycle_without_limit_ends_only_by_failure(kind: Kind) -> None:
    world = World(repeat(-1, A) if kind is Kind.REPEAT else keep_running(A))
    for _ in range(4):
        world.succeed("a")
        assert world.status is RUNNING
    world.fail("a")
    assert world.status is FAILURE


def test_retry_without_limit_ends_only_by_success() -> None:
    world = World(retry(-1, A))
    for _ in range(4):
        world.fail("a")
        assert world.asked() == ["a"]
    world.succeed("a")
    assert world.status is SUCCESS


def test_a_condition_alone_uses_up_no_attempt() -> None:
    world = World(retry(2, sequence(condition("c"), A)))
    flip(world, times=7)
    assert parse_activation(world.activation("a")).attempts == (0,)


def test_where_conditions_alone_decide_a_limited_node_passes_their_result_on() -> None:
    assert World(retry(3, condition("c"))).status is FAILURE
    assert World(repeat(3, condition("c")), true_at_first=["c"]).status is SUCCESS


def test_where_conditions_alone_decide_a_node_without_limit_waits() -> None:
    waiting = World(retry(-1, condition("c")))
    assert waiting.status is RUNNING
    waiting.set("c", True)
    assert waiting.status is SUCCESS
    assert World(repeat(-1, condition("c")), true_at_first=["c"]).status is RUNNING
    assert World(keep_running(condition("c")), true_at_first=["c"]).status is RUNNING
    assert World(keep_running(condition("c"))).status is FAILURE


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


def test_the_attempts_of_a_guarded_retry_begin_again_after_the_guard_turned() -> None:
    world = World(sequence(condition("c"), retry(2, A)), true_at_first=["c"])
    world.fail("a")
    world.fail("a")
    assert world.status is FAILURE
    flip(world)
    world.fail("a")
    assert world.asked() == ["a"]


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


def test_an_attempt_number_beyond_the_limit_reads_as_the_last_one() -> None:
    world = World(retry(2, A))
    scope = str(Activation("r1", 0, "", (), 0))
    world.write("R9", (f"attempt/{scope}", 7))
    requested = world.activation("a")
    assert parse_activation(requested).attempts == (1,)
    assert not world.evaluator.is_obsolete(parse_activation(requested), world.facts)


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
