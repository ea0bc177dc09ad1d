"""How a team reads its facts: task statuses, conditions, commands, what is kept and accepted."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import (
    CLAIM,
    MEMBER,
    TRAVEL_TIMES,
    Claim,
    NoClaim,
    Phase,
    TeamOrder,
)
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.facts.validation import refusal_reason
from mrbt_mesh.core.mission.mission import MICRO, FailurePolicy, MissionEnd
from mrbt_mesh.core.mission.travel import Travel
from tests.support.build import (
    RUN,
    World,
    action,
    condition,
    fallback,
    make_mission,
    refusal,
    repeat,
    retry,
    sequence,
    task,
    timeout,
)

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE
PAPER, RESILIENT = FailurePolicy.PAPER, FailurePolicy.RESILIENT
ACTIVATION = "r1:0:lift::0"


def team(policy: FailurePolicy, needed: int, allowed: int, able: str = "A B C") -> World:
    """Robots A, B, C (those in `able` can lift) and one global task that needs lifting."""
    robots = {name: {"lift": 1} if name in able.split() else {"look": 1} for name in "ABC"}
    lift = task("lift", ("lift", needed, allowed), failure=policy)
    return World(make_mission(action("lift"), robots, [lift]))


def play(world: World, script: str) -> Status:
    """`A+` succeeds, `A-` fails, `A?` claims, `A!` dies, `A~` cannot any more, `A*` restarts."""
    for robot, event in script.split():
        match event:
            case "+" | "-":
                world.outcome(ACTIVATION, event == "+", robot)
                world.write(robot, ("claim", None))
            case "?":
                world.claim(robot, ACTIVATION)
            case "!":
                world.die(robot)
            case "~":
                world.lose(robot, "lift")
            case "*":
                world.join(robot, world.facts.members[robot].member.capabilities, life=2)
    return world.facts.task_status("lift", ACTIVATION)


# -- Perform Global Task ----------------------------------------------------------------------


@pytest.mark.parametrize("policy", [PAPER, RESILIENT])
def test_a_task_succeeds_with_at_least_nu_successes_of_each_local_task(
    policy: FailurePolicy,
) -> None:
    robots = {name: {"lift": 1, "look": 1} for name in "ABC"}
    both = task("both", ("lift", 2, 3), ("look", 1, 1), failure=policy)
    world = World(make_mission(action("both"), robots, [both]))
    name = world.activation("both")
    for robot, local, expected in (("A", "lift", 1), ("B", "look", 1), ("C", "lift", 2)):
        world.outcome(name, True, robot, local)
        assert world.facts.task_status("both", name) == Status(expected)


@pytest.mark.parametrize(
    ("needed", "script", "expected"),
    [(1, "A?", RUNNING), (1, "A? A! B-", FAILURE), (2, "A+ B-", FAILURE), (1, "A+", SUCCESS)],
)
def test_with_the_policy_first_the_first_failure_counts(
    needed: int, script: str, expected: Status
) -> None:
    """Whoever could still try, and whatever a dead robot may have done."""
    assert play(team(FailurePolicy.FIRST, needed, needed), script) is expected


@pytest.mark.parametrize(
    ("needed", "allowed", "script", "expected"),
    [
        # failures exceed assigned - nu, where assigned = outcomes and valid claims
        (1, 1, "", RUNNING),
        (1, 1, "A?", RUNNING),
        (1, 1, "A-", FAILURE),
        (1, 2, "A? B? A-", RUNNING),
        (1, 2, "A? B? A- B-", FAILURE),
        (1, 2, "A? B? A- B+", SUCCESS),
        (2, 2, "A? B? A-", FAILURE),
        (2, 3, "A? B? C? A-", RUNNING),
        (2, 3, "A? B? C? A- B-", FAILURE),
        (2, 3, "A? B? C? A- B+ C+", SUCCESS),
        # at least one failure: too few robots alone is no failure
        (3, 3, "A?", RUNNING),
        (2, 2, "A+", RUNNING),
        # death changes nothing, a new incarnation voids the claim
        (1, 2, "A? B? A- B!", RUNNING),
        (1, 2, "A? B? A- B! B*", FAILURE),
    ],
)
def test_failure_by_the_papers_policy(
    needed: int, allowed: int, script: str, expected: Status
) -> None:
    assert play(team(PAPER, needed, allowed), script) is expected


@pytest.mark.parametrize(
    ("needed", "able", "script", "expected"),
    [
        # successes and capable members without a failure are fewer than nu
        (1, "A B C", "A-", RUNNING),
        (1, "A B C", "A- B-", RUNNING),
        (1, "A B C", "A- B- C-", FAILURE),
        (1, "A B", "A- B-", FAILURE),
        (2, "A B C", "A+ B-", RUNNING),
        (2, "A B C", "A- B-", FAILURE),
        (2, "A B C", "A+ B- C-", FAILURE),
        (2, "A B C", "A+ B- C+", SUCCESS),
        # the dead and those who lost the capability count: they may come back
        (1, "A B", "A- B!", RUNNING),
        (1, "A B", "A- B~", RUNNING),
        (1, "A B", "B~ B! A-", RUNNING),
        (2, "A B", "A! B!", RUNNING),
        (2, "A B C", "A- B! C!", RUNNING),
        # too few robots alone is no failure but blocked
        (3, "A B", "", RUNNING),
        (3, "A B", "A+", RUNNING),
        (3, "A B", "A+ B-", FAILURE),
        # an outcome outlives its author's restart
        (1, "A B", "A- A! A* B-", FAILURE),
    ],
)
def test_failure_by_the_resilient_policy(
    needed: int, able: str, script: str, expected: Status
) -> None:
    assert play(team(RESILIENT, needed, 3, able), script) is expected


@pytest.mark.parametrize("policy", [PAPER, RESILIENT])
@given(st.lists(st.sampled_from(("A+", "A-", "B+", "B-", "C-", "A?", "B?", "C~")), max_size=8))
def test_statuses_never_depend_on_who_is_thought_alive(
    policy: FailurePolicy, events: list[str]
) -> None:
    living, dying = team(policy, 2, 3), team(policy, 2, 3)
    script = " ".join(events)
    assert play(living, script) is play(dying, f"{script} A! B! C!".strip())


def test_a_latched_failure_stays_although_robots_come() -> None:
    world = team(RESILIENT, 1, 1, able="A")
    world.fail("lift", "A")
    assert world.status is FAILURE
    world.join("D", {"lift": 1})
    assert world.status is FAILURE


def test_a_late_success_wins_over_a_latched_failure() -> None:
    world = team(RESILIENT, 1, 1, able="A")
    world.fail("lift", "A")
    assert world.status is FAILURE
    world.outcome(ACTIVATION, True, "B")
    assert world.status is SUCCESS


# -- conditions -------------------------------------------------------------------------------


def open_door(default: bool = False) -> World:
    return World(sequence(condition("open"), action("go")), ["open"] if default else [])


def tell(world: World, author: str, value: bool, changes: int, stamp: int) -> None:
    world.write(author, ("condition/open", [value, changes, stamp]))


@pytest.mark.parametrize("default", [False, True])
def test_a_condition_that_nobody_set_reads_as_its_default(default: bool) -> None:
    assert open_door(default).facts.condition("open") is default


def test_the_greatest_revision_counts_then_the_stamp_then_the_author() -> None:
    world = open_door()
    tell(world, "B", True, 1, 9)
    assert world.facts.condition("open")
    tell(world, "A", False, 2, 1)
    assert not world.facts.condition("open")
    tell(world, "C", True, 1, 99)
    assert not world.facts.condition("open")
    assert world.facts.conditions.changes("open") == 2
    assert world.facts.max_stamp == 99


@pytest.mark.parametrize("default", [False, True])
def test_turns_count_how_often_the_value_was_reached(default: bool) -> None:
    world = open_door(default)
    counted = {True: 0, False: 0}
    for _ in range(5):
        value = not world.facts.condition("open")
        world.set("open", value)
        counted[value] += 1
        assert {v: world.facts.turns("open", v) for v in (True, False)} == counted


def test_a_value_that_disagrees_with_its_revision_is_not_accepted() -> None:
    world = open_door()
    version = Version(Incarnation(1, "n"), 1)
    wrong = parse_entry("A", "condition/open", version, [True, 2, 1])
    reason = refusal(world.facts, wrong)
    assert reason is not None
    assert "count 2 disagree" in reason


# -- the operator's commands ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("commands", "standing"),
    [
        ([], "resume"),
        ([("pause", 1, "A")], "pause"),
        ([("pause", 1, "A"), ("resume", 2, "B")], "resume"),
        ([("resume", 2, "A"), ("pause", 1, "B")], "resume"),
        ([("pause", 1, "A"), ("resume", 1, "B")], "resume"),
        ([("resume", 1, "A"), ("pause", 1, "B")], "pause"),
        ([("abort", 1, "A"), ("resume", 2, "A"), ("resume", 3, "B")], "abort"),
    ],
)
def test_the_latest_order_stands_and_abort_absorbs(
    commands: list[tuple[str, int, str]], standing: str
) -> None:
    world = open_door()
    for kind, stamp, author in commands:
        world.order(kind, stamp, author)
    assert world.facts.order() is TeamOrder(standing)


# -- where robots are -------------------------------------------------------------------------

MOVES = st.lists(
    st.tuples(st.sampled_from("AB"), st.sampled_from([*Phase, None]), st.sampled_from(["x", "y"])),
    max_size=8,
)


@given(MOVES, st.randoms(use_true_random=False), st.booleans())
def test_a_robot_is_where_its_newest_claim_says(
    moves: list[tuple[str, Phase | None, str]], shuffled: random.Random, restarts: bool
) -> None:
    world = team(RESILIENT, 1, 1)
    assert (world.facts.place_of("A"), world.facts.under_way("A")) == ("", "")
    places = Travel(dict.fromkeys("xyz", (0, 0)), {"lift": "z"}, {"A": "x"})
    mission = replace(world.mission, travel=places)
    facts, entries = TeamFacts(mission, RUN), list(world.facts.map)
    found = {"A": ("x", ""), "B": ("", "")}
    for number, (robot, phase, place) in enumerate(moves, 2):
        claim = Claim(ACTIVATION, "lift", "lift", phase, 1, place=place) if phase else None
        version = Version(world.alive[robot], number)
        entries.append(make_entry(robot, CLAIM, version, claim or NoClaim(place)))
        goal = "z" if phase is Phase.TRAVELLING and not restarts else ""
        found[robot] = (place, goal)
    if restarts:
        entries += [
            replace(each, version=Version(Incarnation(2, "n"), 1))
            for each in world.facts.map
            if each.name == MEMBER
        ]
    shuffled.shuffle(entries)
    facts.map.merge(entries)
    assert {r: (facts.place_of(r), facts.under_way(r)) for r in "AB"} == found
    assert facts.place_of("stranger") == ""


def test_places_that_the_mission_does_not_have_are_refused() -> None:
    world = team(RESILIENT, 1, 1)
    places = replace(world.mission, travel=Travel({"x": (0, 0)}, {"lift": "x"}, {"A": "x"}))
    for mission, place, reason in (
        (world.mission, "x", "this mission has no place 'x'"),
        (places, "y", "this mission has no place 'y'"),
        (places, "x", None),
        (places, "", None),
    ):
        entry = make_entry("A", CLAIM, Version(world.alive["A"], 2), NoClaim(place))
        assert refusal_reason(entry, mission, RUN) == reason


@given(st.permutations(range(3)))
def test_the_newest_travel_times_of_a_robot_count(order: list[int]) -> None:
    world = team(RESILIENT, 1, 1)
    places = {"x": (0, 0), "y": (MICRO, 0), "z": (3 * MICRO, 0)}
    travel = Travel(places, {"lift": "z"}, {"A": "x"}, {"T": MICRO})
    facts = TeamFacts(replace(world.mission, travel=travel), RUN)
    facts.map.merge(world.facts.map)
    said = [[["x", "z"], [[7, 5_000], [None, 0]]], [["x", "z"], [[0, 6_000], [None, 0]]], [[], []]]
    entries = [
        parse_entry("A", TRAVEL_TIMES, Version(world.alive["A"], number), value)
        for number, value in enumerate(said, 2)
    ]
    entries += [parse_entry("B", TRAVEL_TIMES, Version(world.alive["B"], 9), [["q"], [[0]]])]
    assert refusal_reason(entries[3], facts.mission, RUN) == "this mission has no place 'q'"
    assert refusal_reason(entries[2], world.mission, RUN) == "this mission has no places"
    known = [0, 0]
    for number in order:
        assert refusal_reason(entries[number], facts.mission, RUN) is None
        facts.map.merge([entries[number]])
        known = max(known, [number, [5_000, 6_000, 3_000][number]])
        assert facts.travel_table("A") == [
            [0, 1_000, known[1]],
            [1_000, 0, 2_000],
            [3_000, 2_000, 0],
        ]
    assert facts.travel_table("B") is travel.table("T")


# -- members, claims, capabilities ------------------------------------------------------------


def test_a_claim_is_void_once_its_author_has_a_new_incarnation() -> None:
    world = team(RESILIENT, 1, 1)
    world.claim("A", ACTIVATION)
    assert world.facts.valid_claim("A") is not None
    assert play(world, "A*") is RUNNING
    assert world.facts.valid_claim("A") is None


def test_a_capability_is_lost_by_its_type_or_for_one_argument() -> None:
    world = World(make_mission(action("go")), joined=False)
    world.join("A", {"fix": 5, "fix(2)": 9, "look": 1}, lost=("fix(3)", "look"))
    member = world.facts.members["A"].member
    asked = ("fix(1)", "fix(2)", "fix(3)", "look", "fly")
    assert [capability(member, name) for name in asked] == [5, 9, None, None, None]


# -- what is dropped, what is taken in --------------------------------------------------------


def test_used_up_attempts_and_turned_guards_drop_what_nobody_can_reach() -> None:
    world = World(sequence(condition("c"), retry(3, action("a"))), true_at_first=["c"])
    world.fail("a")
    world.tick()
    kept_before = {e.name for e in world.facts.map}
    assert "outcome/r1:3:a:0:0/a" in kept_before
    world.facts.prune()
    assert {e.name for e in world.facts.map} == {"member", "attempt/r1:2:::0"}
    world.set("c", True)
    world.set("c", False)
    world.facts.prune()
    assert {e.name for e in world.facts.map} == {"member", "condition/c"}


def test_what_can_still_be_reached_is_kept() -> None:
    world = World(fallback(repeat(-1, action("a")), action("b")))
    world.succeed("a")
    world.tick()
    world.fail("a")
    assert world.asked() == ["b"]
    world.facts.prune()
    assert world.asked() == ["b"]
    assert world.facts.has_latched_failure("r1:2:a:1:0")


def test_dropping_again_drops_nothing() -> None:
    world = World(retry(3, action("a")))
    world.fail("a")
    world.tick()
    assert len(world.facts.prune()) == 1
    assert world.facts.prune() == []


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("condition/shut", [True, 1, 1], "condition 'shut' is not declared"),
        ("condition/c(1)", [True, 1, 1], "condition 'c(1)' is not declared"),
        ("condition/c c", [True, 1, 1], "is not declared"),
        ("outcome/nonsense/a", [True, None], "names no activation"),
        ("outcome/r1:2:a::0:0/a", [True, None], "names no activation"),
        ("latched_failure/r1:2:a:x:0", True, "names no activation"),
        ("outcome/r0:2:a::0/a", [True, None], "belongs to another run"),
        ("outcome/r1:6:a::0/a", [True, None], "names no node of this mission's tree"),
        ("outcome/r1:-1:a::0/a", [True, None], "names no node of this mission's tree"),
        ("outcome/r1:2:b::0/b", [True, None], "names no node of this mission's tree"),
        ("outcome/r1:2:a:0:0/a", [True, None], "names no node of this mission's tree"),
        ("outcome/r1:2:a::-1/a", [True, None], "names no node of this mission's tree"),
        ("attempt/r1:00:::0", 1, "names no node of this mission's tree"),
        ("outcome/r1:0:::0/a", [True, None], "names no node of this mission's tree"),
        ("attempt/r1:2:a::0", 1, "names no node of this mission's tree"),
        ("expired/r1:0:::0", True, "names no node of this mission's tree"),
        ("outcome/r1:2:a::0/b", [True, None], "'a' needs no 'b'"),
        ("claim", None, None),
        ("condition/c", [True, 1, 1], None),
        ("outcome/r1:2:a::7/a", [True, None], None),
        ("latched_failure/r1:2:a::0", True, None),
        ("attempt/r1:3:::0", 1, None),
        ("expired/r1:4::2:0", True, None),
        ("outcome/r1:5:d:2:0/d", [True, None], None),
    ],
)
def test_entries_that_have_no_place_in_the_mission_are_not_accepted(
    name: str, value: object, reason: str | None
) -> None:
    tree = sequence(condition("c"), action("a"), retry(3, timeout(1, action("d"))))
    facts = TeamFacts(make_mission(tree), "r1")
    found = refusal(facts, parse_entry("Z", name, Version(Incarnation(1, "n"), 1), value))
    assert (found is None) == (reason is None)
    assert (reason or "") in (found or "")


def test_facts_are_indexed_the_same_after_entries_came_and_went() -> None:
    world = World(retry(-1, sequence(action("a"), action("b"))))
    for _ in range(3):
        world.succeed("a")
        world.fail("b")
        world.tick()
        world.facts.prune()
    fresh = world.replayed(list(world.facts.map))
    assert fresh.facts.activations == world.facts.activations
    assert fresh.evaluator.evaluate(fresh.facts) == world.tick()
    assert fresh.facts.map.digest() == world.facts.map.digest()


def test_a_mission_that_never_ends_has_no_result() -> None:
    world = World(action("a"))
    entry = parse_entry("R1", "result", Version(Incarnation(1, "n"), 1), [True, 1])
    assert refusal(world.facts, entry) is None
    never = World(replace(world.mission, ends=MissionEnd.NEVER))
    assert refusal(never.facts, entry) == "this mission never ends"


@pytest.mark.parametrize(
    ("results", "alive", "expected"),
    [
        ([], "R1", None),
        ([(False, 3)], "R1 R2 R3", Status.FAILURE),
        ([(False, 2)], "R1 R2 R3", Status.FAILURE),  # most of the three
        ([(False, 1)], "R1 R2 R3", None),
        ([(False, 1)], "R2 R3", None),
        ([(False, 1)], "R3", Status.FAILURE),
        ([(False, 3), (True, 2)], "R1 R2 R3", Status.SUCCESS),
        ([(False, 3), (True, 1)], "R1 R2 R3", Status.FAILURE),
        ([(False, 3), (True, 1)], "R1", Status.SUCCESS),
        ([(False, 1), (True, 1), (False, 2)], "R1 R2 R3 guest", Status.FAILURE),
    ],
)
def test_the_result_on_which_most_have_agreed_counts(
    results: list[tuple[bool, int]], alive: str, expected: Status | None
) -> None:
    """Also one of fewer, where no more are alive; in whichever order they arrive."""
    mission = make_mission(action("a"), {name: {"a": 1.0} for name in ("R1", "R2", "R3")})
    version = Version(Incarnation(1, "n"), 1)
    entries = [
        parse_entry(f"R{number}", "result", version, list(value))
        for number, value in enumerate(results, 1)
    ]
    for order in itertools.permutations(entries):
        facts = TeamFacts(mission, "r")
        for entry in (*order, *order):
            facts.map.merge([entry])
        assert facts.result(alive.split()) is expected
