"""Coalitions: whose successes count, when one is broken, who may judge, and doubts."""

from __future__ import annotations

import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.mission.mission import FailurePolicy
from mrbt_mesh.features.exclusive.coalitions import coalition_at_work, newly_broken
from mrbt_mesh.features.exclusive.fields import InDoubtPolicy
from mrbt_mesh.features.exclusive.kinds import BROKEN, CLEARED, DECISION, DOUBT, GRANT
from mrbt_mesh.features.exclusive.records import CoalitionId
from tests.support.build import World, action, fallback, make_mission, refusal, sequence, task

COVER = "r1:0:cover::0"
TEAM = {name: {"lift": 1} for name in "ABCD"}


def cover(**policies: Any) -> World:
    """Four robots; two of them have to lift the cover together, three may."""
    lifted = task("cover", ("lift", 2, 3), simultaneous=True, **policies)
    return World(make_mission(action("cover"), TEAM, [lifted]))


def dosing(in_doubt: InDoubtPolicy = InDoubtPolicy.HOLD) -> World:
    """Three robots; one doses, only once, and then another thing is done."""
    dose = task("dose", ("pour", 1, 1), exclusive=True, in_doubt=in_doubt)
    robots = {"A": {"pour": 2}, "B": {"pour": 1}, "C": {"look": 1}}
    return World(make_mission(fallback(action("dose"), action("look")), robots, [dose]))


def broken(world: World, me: str) -> list[str]:
    found = world.mission.global_tasks["cover"]
    return [t.leader for t in newly_broken(world.facts, found, COVER, world.alive, me)]


def on_it(world: World) -> list[str]:
    return list(world.plan().assignments)


# -- whose successes count --------------------------------------------------------------------


def test_a_task_succeeds_with_nu_successes_of_one_coalition() -> None:
    world = cover()
    token = world.form(COVER, "A", "B")
    world.end(COVER, token, "A", True, "lift")
    assert world.status is Status.RUNNING
    world.end(COVER, token, "B", True, "lift")
    assert world.status is Status.SUCCESS


def test_successes_of_two_coalitions_do_not_add_up() -> None:
    world = cover()
    first = world.form(COVER, "A", "B")
    world.end(COVER, first, "A", True, "lift")
    world.say(BROKEN, COVER, first, "A")
    second = world.form(COVER, "C", "D", since=5)
    world.end(COVER, second, "C", True, "lift")
    assert world.status is Status.RUNNING
    world.end(COVER, first, "B", True, "lift")  # late, but it counts
    assert world.status is Status.SUCCESS


def test_every_local_task_needs_its_successes_in_the_same_coalition() -> None:
    both = task("move", ("hold", 1, 1), ("pull", 1, 1), simultaneous=True)
    robots = {"A": {"hold": 1, "pull": 1}, "B": {"hold": 1, "pull": 1}}
    world = World(make_mission(action("move"), robots, [both]))
    name = world.activation("move")
    world.ready("A", name, "hold")
    world.ready("B", name, "pull")
    token = CoalitionId(1, "A", *world.alive["A"])
    rows = [["A", "hold", 1, "n", 3, 1], ["B", "pull", 1, "n", 4, 1]]
    world.write("A", (f"coalition/{name}/{token}", rows))
    world.end(name, token, "A", True, "hold")
    assert world.status is Status.RUNNING
    world.end(name, token, "B", True, "pull")
    assert world.status is Status.SUCCESS


# -- bounds and pins --------------------------------------------------------------------------


def test_without_a_coalition_the_bounds_are_nu_and_mu() -> None:
    assert on_it(cover()) == ["A", "B", "C"]


def test_ready_robots_are_not_pinned() -> None:
    world = cover()
    world.ready("D", COVER, "lift")
    assert on_it(world) == ["A", "B", "C"]


def test_whoever_started_goes_on_and_nobody_joins() -> None:
    world = cover()
    world.form(COVER, "B", "D")
    plan = world.plan()
    assert list(plan.assignments) == ["B", "D"]
    assert all(line.pinned and line.leader == "B" for line in plan.assignments.values())


def test_a_member_that_has_finished_is_free_and_has_not_dropped_out() -> None:
    world = cover()
    token = world.form(COVER, "A", "B")
    world.end(COVER, token, "A", True, "lift")
    assert on_it(world) == ["B"]
    assert broken(world, "B") == []
    assert broken(world, "C") == []


def test_after_a_broken_coalition_its_robots_begin_anew() -> None:
    world = cover()
    token = world.form(COVER, "A", "B")
    world.end(COVER, token, "A", True, "lift")
    world.say(BROKEN, COVER, token, "C")
    plan = world.plan()
    assert list(plan.assignments) == ["A", "B", "C"]
    assert [line.round for line in plan.assignments.values()] == [1, 1, 1]


# -- when a coalition is broken ---------------------------------------------------------------


def test_a_death_breaks_a_coalition_for_its_members_and_leaves_it_to_others_to_plan_anew() -> None:
    world = cover()
    world.form(COVER, "A", "B")
    world.die("B")
    assert broken(world, "A") == ["A"]
    assert broken(world, "C") == []  # B may be at it out of reach of C
    assert on_it(world) == ["A", "C", "D"]


def test_a_spare_member_may_go() -> None:
    world = cover()
    world.form(COVER, "A", "B", "C")
    world.die("C")
    assert broken(world, "A") == []
    assert on_it(world) == ["A", "B"]


def test_a_failure_that_leaves_too_few_breaks_it_and_the_robot_is_not_asked_again() -> None:
    world = cover()
    token = world.form(COVER, "A", "B")
    world.end(COVER, token, "B", False, "lift")
    assert broken(world, "D") == ["A"]
    world.say(BROKEN, COVER, token, "A")
    assert on_it(world) == ["A", "C", "D"]


@pytest.mark.parametrize("change", ["no claim", "another claim", "new life"])
def test_a_member_that_gave_its_claim_up_has_dropped_out(change: str) -> None:
    world = cover()
    world.form(COVER, "A", "B")
    if change == "no claim":
        world.write("B", (records.CLAIM, None))
    elif change == "another claim":
        world.ready("B", COVER, "lift", since=9)
    else:
        world.join("B", {"lift": 1}, life=2)
        world.write("B", (records.CLAIM, None))
    assert broken(world, "C") == ["A"]


def test_a_claim_that_has_not_arrived_yet_is_no_drop_out() -> None:
    world = cover()
    world.form(COVER, "A", "B")
    late = world.replayed(e for e in world.entries if (e.author, e.name) != ("B", records.CLAIM))
    assert broken(late, "C") == []
    assert list(late.plan().assignments) == ["A", "B"]


def test_of_two_coalitions_the_first_by_the_order_of_claims_stands() -> None:
    world = cover()
    world.form(COVER, "C", "D", since=4)
    world.form(COVER, "A", "B", since=7)
    assert on_it(world) == ["C", "D"]
    assert broken(world, "B") == ["A"]
    alive = world.alive
    token = coalition_at_work(world.facts, world.mission.global_tasks["cover"], COVER, alive)
    assert token is not None
    assert token.leader == "C"


# -- failure ----------------------------------------------------------------------------------


def test_resilient_fails_when_fewer_than_nu_capable_robots_have_not_failed() -> None:
    world = cover()
    first = world.form(COVER, "A", "B")
    world.end(COVER, first, "A", False, "lift")
    world.end(COVER, first, "B", False, "lift")
    assert world.status is Status.RUNNING
    second = world.form(COVER, "C", "D", since=5)
    world.end(COVER, second, "C", False, "lift")
    assert world.status is Status.FAILURE


def test_by_the_papers_count_one_failure_of_two_is_enough() -> None:
    world = cover(failure=FailurePolicy.PAPER)
    token = world.form(COVER, "A", "B")
    world.end(COVER, token, "A", False, "lift")
    assert world.status is Status.FAILURE


def test_by_the_papers_count_a_spare_member_may_fail() -> None:
    world = cover(failure=FailurePolicy.PAPER)
    token = world.form(COVER, "A", "B", "C")
    world.end(COVER, token, "A", False, "lift")
    assert world.status is Status.RUNNING


# -- exclusive tasks --------------------------------------------------------------------------


def dose_name(world: World) -> str:
    return world.activation("dose")


def reason(world: World) -> str:
    return "; ".join(waiting.reason for waiting in world.plan().waiting)


def test_an_exclusive_task_waits_for_a_living_majority() -> None:
    world = dosing()
    assert on_it(world) == ["A"]
    world.die("B")
    world.die("C")
    assert on_it(world) == []
    assert reason(world) == "blocked: exclusive: needs grants from 2 of 3 robots, 1 here"


def test_a_coalition_out_of_reach_stands_until_its_grants_have_run_out() -> None:
    world = dosing()
    name = dose_name(world)
    token = world.form(name, "A")
    world.say(GRANT, name, token, "A", "B")
    world.die("A")
    assert on_it(world) == []
    assert reason(world) == "blocked: A is out of reach and may still be at it"
    world.say(DOUBT, name, token, "B")  # C's grant may still be in force
    assert "out of reach" in reason(world)
    world.say(DOUBT, name, token, "C")
    assert reason(world).startswith("blocked: in doubt: nobody knows how far A got")


def test_a_members_own_word_leaves_it_in_doubt_at_once() -> None:
    world = dosing()
    name = dose_name(world)
    token = world.form(name, "A")
    world.say(DOUBT, name, token, "A")
    assert "in doubt" in reason(world)


@pytest.mark.parametrize("finished_first", [True, False])
def test_a_member_that_has_finished_doubts_as_a_giver_only(finished_first: bool) -> None:
    """It may not hear those that are still at it: over a broken link, they cannot renew its grant.

    Who has stopped and then finished all the same has given its word.
    """
    dose = task("dose", ("pour", 2, 2), exclusive=True)
    robots = {"A": {"pour": 2}, "B": {"pour": 1}, "C": {"look": 1}}
    world = World(make_mission(fallback(action("dose"), action("look")), robots, [dose]))
    name = dose_name(world)
    token = world.form(name, "A", "B")
    world.say(GRANT, name, token, "A", "B", "C")
    if finished_first:
        world.end(name, token, "B", True, "pour")
        world.say(DOUBT, name, token, "B")
        assert coalition_at_work(world.facts, dose, name, world.alive) == token
        world.say(DOUBT, name, token, "C")  # the grants that are left are no majority
    else:
        world.say(DOUBT, name, token, "B")
        world.end(name, token, "B", True, "pour")
    assert coalition_at_work(world.facts, dose, name, world.alive) is None
    assert "in doubt" in reason(world)


@pytest.mark.parametrize("kind", ["retry", "outcome"])
def test_what_dissolves_a_doubt(kind: str) -> None:
    world = dosing()
    name = dose_name(world)
    token = world.form(name, "A")
    world.say(DOUBT, name, token, "A")
    if kind == "retry":
        world.command(f"{DECISION}/{name}/{token}", "retry")
        assert on_it(world) == ["A"]
    else:
        world.end(name, token, "A", True, "pour")
        assert world.status is Status.SUCCESS


@pytest.mark.parametrize(
    ("policy", "asked", "team"),
    [
        (InDoubtPolicy.HOLD, ["dose"], []),
        (InDoubtPolicy.FAIL, ["look"], ["C"]),
        (InDoubtPolicy.RETRY, ["dose"], ["A"]),
    ],
)
def test_the_three_policies_for_doubt(
    policy: InDoubtPolicy, asked: list[str], team: list[str]
) -> None:
    world = dosing(policy)
    name = dose_name(world)
    token = world.form(name, "A")
    world.say(DOUBT, name, token, "A")
    assert world.asked() == asked
    assert on_it(world) == team


@pytest.mark.parametrize(
    ("decision", "status"), [("done", Status.SUCCESS), ("failed", Status.FAILURE)]
)
def test_an_operator_may_decide_how_it_ended(decision: str, status: Status) -> None:
    world = dosing()
    name = dose_name(world)
    token = world.form(name, "A")
    world.say(DOUBT, name, token, "A")
    world.command(f"{DECISION}/{name}/{token}", decision, stamp=2)
    assert world.facts.task_status("dose", name) is status
    world.command(f"{DECISION}/{name}/{token}", "retry", stamp=3)
    assert world.facts.task_status("dose", name) is status, "the first decision counts"


def test_only_its_leader_can_tell_that_a_coalition_never_began() -> None:
    world = dosing()
    name = dose_name(world)
    token = world.form(name, "A")
    entry = parse_entry("C", f"{CLEARED}/{name}/{token}", Version(Incarnation(1, "x"), 9), True)
    assert "is for A to write" in str(refusal(world.facts, entry))


def test_a_clean_failure_is_no_doubt_and_another_robot_may_try() -> None:
    world = dosing()
    name = dose_name(world)
    token = world.form(name, "A")
    world.say(GRANT, name, token, "A", "B", "C")
    world.end(name, token, "A", False, "pour")
    world.say(BROKEN, name, token, "C")
    world.say(DOUBT, name, token, "B", "C")  # their grants ran out, the outcome came late
    assert on_it(world) == ["B"]


# -- what is refused --------------------------------------------------------------------------

TOKEN = "A.1.n.1"


@pytest.mark.parametrize(
    ("author", "name", "value"),
    [
        ("A", f"outcome/{COVER}/lift", [True, None]),
        ("A", f"outcome/{COVER}/fly/{TOKEN}", [True, None]),
        ("A", f"outcome/{COVER}/lift/A.1.n", [True, None]),
        ("A", f"outcome/{COVER}/lift/A.01.n.1", [True, None]),
        ("B", f"coalition/{COVER}/{TOKEN}", [["A", "lift", 1, "n", 1, 1]]),
        ("A", f"coalition/{COVER}/{TOKEN}", [["A", "fly", 1, "n", 1, 1]]),
        ("A", f"grant/{COVER}/{TOKEN}", True),
        (records.OPERATORS, f"decision/{COVER}/{TOKEN}", ["done", "op", "", ""]),
        ("A", f"decision/{COVER}/{TOKEN}", ["done", "op", "", ""]),
    ],
)
def test_what_fits_no_coalition_is_refused(author: str, name: str, value: Any) -> None:
    world = cover()
    entry = parse_entry(author, name, Version(world.alive["A"], 50), value)
    assert refusal(world.facts, entry) is not None


def test_an_ordinary_task_has_no_coalitions() -> None:
    world = World(make_mission(action("cover"), {"A": {"cover": 1}}))
    for name, value in (
        (f"outcome/{COVER}/cover/{TOKEN}", [True, None]),
        (f"broken/{COVER}/{TOKEN}", True),
    ):
        entry = parse_entry("A", name, Version(world.alive["A"], 50), value)
        assert refusal(world.facts, entry) is not None


@pytest.mark.parametrize("text", ["", "A", "A.x.n.1", "A.1.n.-1", "A.1.n.1.2", "A.1.n. 1"])
def test_what_is_no_token_is_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        CoalitionId.parse(text)


# -- any order of arrival ---------------------------------------------------------------------


@given(st.randoms(use_true_random=False), st.booleans())
def test_the_order_in_which_facts_arrive_makes_no_difference(
    rng: random.Random, exclusive: bool
) -> None:
    world = World(
        make_mission(
            sequence(action("cover"), action("next")),
            TEAM | {"E": {"next": 1}},
            [task("cover", ("lift", 2, 2), simultaneous=True, exclusive=exclusive)],
        )
    )
    name = world.activation("cover")
    first = world.form(name, "A", "B")
    world.end(name, first, "A", True, "lift")
    kinds = (BROKEN, *((DOUBT, CLEARED) if exclusive else ()))
    for kind in kinds:
        if rng.random() < 0.5:
            world.say(kind, name, first, "A" if kind == CLEARED else rng.choice("ABCD"))
    second = world.form(name, "C", "D", since=6)
    world.end(name, second, "C", rng.random() < 0.5, "lift")
    if rng.random() < 0.5:
        world.end(name, first, "B", True, "lift")
    if exclusive and rng.random() < 0.5:
        world.say(DOUBT, name, rng.choice([first, second]), rng.choice("ABCD"))
    shuffled = list(world.entries)
    rng.shuffle(shuffled)
    assert world.replayed(shuffled).plan().packed == world.plan().packed
