"""Pending failures: a robot has failed, and no living robot can make it good."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.mission.mission import FailurePolicy
from mrbt_mesh.core.planning.deadlines import Deadlines
from mrbt_mesh.features.constraints.kinds import SECTION, NeverTogether
from mrbt_mesh.features.exclusive.fields import InDoubtPolicy
from mrbt_mesh.features.exclusive.kinds import BROKEN, DOUBT, GRANT
from tests.support.build import World, action, fallback, make_mission, task

RESILIENT, PAPER = FailurePolicy.RESILIENT, FailurePolicy.PAPER


def world_of(able: str = "R1 R2 R3", *needs: tuple[Any, ...], **policies: Any) -> World:
    """Fallback(a, b); the robots can do `a`, R9 and R8 can do `b`."""
    robots: dict[str, dict[str, float]] = {robot: {"a": 1} for robot in able.split()}
    robots |= {"R8": {"b": 1}, "R9": {"b": 1}}
    tree = fallback(action("a"), action("b"))
    return World(make_mission(tree, robots, [task("a", *(needs or (("a", 1, 1),)), **policies)]))


def pending(world: World) -> list[str]:
    """The subjects that are about to fail."""
    return [failure.activation.split(":")[2] for failure in world.plan().pending_failures]


@pytest.mark.parametrize("policy", FailurePolicy)
def test_nothing_is_pending_while_somebody_living_may_try(policy: FailurePolicy) -> None:
    world = world_of(failure=policy)
    assert pending(world) == []
    world.claim("R1", world.activation("a"))
    world.claim("R2", world.activation("a"))
    world.outcome(world.activation("a"), False, "R1")
    assert pending(world) == []


def test_with_the_policy_first_it_has_failed_already() -> None:
    world = world_of("R1 R2", failure=FailurePolicy.FIRST)
    world.claim("R2", world.activation("a"))
    world.outcome(world.activation("a"), False, "R1")
    assert pending(world) == []
    assert world.asked() == ["b"]


@pytest.mark.parametrize("policy", [RESILIENT, PAPER])
def test_the_rest_is_dead_has_lost_it_or_leaves(policy: FailurePolicy) -> None:
    world = world_of("R1 R2 R3 R4", failure=policy)
    for robot in ("R2", "R3", "R4"):
        world.claim(robot, world.activation("a"))
    world.outcome(world.activation("a"), False, "R1")
    world.die("R2")
    world.lose("R3", "a")
    world.write("R3", (records.CLAIM, None))
    assert pending(world) == []
    world.leave("R4")
    assert pending(world) == ["a"]
    assert world.asked() == ["a"], "nothing follows from it before it is a fact"
    (waiting,) = world.plan().waiting
    assert waiting.reason == "blocked: a needs 1, 1 alive, 1 failed; fails unless that changes"


def test_who_has_failed_at_any_part_counts() -> None:
    """R1 has failed at one local task, and for the other one nobody is left."""
    world = world_of("R1 R2", ("a", 1, 1), ("b", 1, 1))
    activation = world.activation("a")
    for robot in ("R8", "R9"):
        world.die(robot)
    assert pending(world) == []
    world.outcome(activation, False, "R1", "a")
    assert pending(world) == ["a"]


@pytest.mark.parametrize("policy", [RESILIENT, PAPER])
def test_who_merely_helped_and_failed_does_not_count(policy: FailurePolicy) -> None:
    """Nobody has failed at what is needed, so the task is blocked."""
    world = world_of("R1", ("a", 1, 1), ("b", 0, 2), failure=policy)
    for robot in ("R8", "R9"):
        world.outcome(world.activation("a"), False, robot, "b")
    world.die("R1")
    assert pending(world) == []
    assert [waiting.is_blocked for waiting in world.plan().waiting] == [True]
    assert world.tick().status is Status.RUNNING


def test_successes_count_for_what_is_needed() -> None:
    world = world_of("R1 R2 R3", ("a", 2, 3))
    world.outcome(world.activation("a"), True, "R1")
    world.outcome(world.activation("a"), False, "R2")
    assert pending(world) == []
    world.die("R3")
    assert pending(world) == ["a"]


def test_nobody_has_failed() -> None:
    world = world_of("R1", blocked_fail_after_us=5)
    world.die("R1")
    assert [w.is_blocked for w in world.plan().waiting] == [True]
    assert pending(world) == []


def test_no_clock_runs_while_the_operator_lets_the_team_rest() -> None:
    world = world_of("R1 R2")
    world.outcome(world.activation("a"), False, "R1")
    world.die("R2")
    assert pending(world) == ["a"]
    world.order("pause")
    assert pending(world) == []


# -- the paper's count ------------------------------------------------------------------------


def test_the_papers_count_is_of_living_robots() -> None:
    world = world_of("R1 R2 R3", ("a", 1, 2), failure=PAPER)
    activation = world.activation("a")
    for robot in ("R1", "R2"):
        world.claim(robot, activation)
    world.outcome(activation, False, "R2")
    assert pending(world) == [], "1 > 2 - 1 is false"
    world.die("R1")
    assert pending(world) == ["a"], "1 > 1 - 1"
    world.claim("R3", activation)
    assert pending(world) == [], "R3 took its place"
    assert world.asked() == ["a"]


def test_the_papers_count_of_a_coalition() -> None:
    world = world_of("R1 R2 R3 R4", ("a", 1, 2), failure=PAPER, simultaneous=True)
    activation = world.activation("a")
    token = world.form(activation, "R1", "R2")
    world.end(activation, token, "R1", False, "a")
    assert pending(world) == []
    world.die("R2")
    assert pending(world) == ["a"]
    world.claim("R3", activation, running=False)
    assert pending(world) == [], "another one is being formed"


# -- coalitions, what is exclusive, side constraints ------------------------------------------


def test_a_coalition_needs_robots_that_have_never_failed() -> None:
    world = world_of("R1 R2 R3 R4", ("a", 2, 2), simultaneous=True)
    activation = world.activation("a")
    token = world.form(activation, "R1", "R2")
    world.end(activation, token, "R1", False, "a")
    world.say(BROKEN, activation, token, "R2")
    assert pending(world) == []
    world.die("R2")
    assert pending(world) == [], "R3 and R4"
    world.die("R3")
    assert pending(world) == ["a"]


@pytest.mark.parametrize("in_doubt", InDoubtPolicy)
def test_what_is_in_doubt_follows_its_own_policy(in_doubt: InDoubtPolicy) -> None:
    world = world_of("R1 R2", exclusive=True, in_doubt=in_doubt)
    activation = world.activation("a")
    first = world.form(activation, "R1")
    world.end(activation, first, "R1", False, "a")
    world.say(BROKEN, activation, first, "R1")
    second = world.form(activation, "R2", since=2)
    world.say(GRANT, activation, second, "R1", "R8", "R9")
    world.die("R2")
    assert pending(world) == [], "it is out of reach, and may be at it"
    world.say(DOUBT, activation, second, "R1", "R8", "R9")
    if in_doubt is InDoubtPolicy.FAIL:
        assert world.asked() == ["b"]
    else:
        assert pending(world) == (["a"] if in_doubt is InDoubtPolicy.RETRY else [])


def test_a_minority_decides_nothing_about_what_is_exclusive() -> None:
    world = world_of("R1 R2", exclusive=True)
    activation = world.activation("a")
    token = world.form(activation, "R1")
    world.end(activation, token, "R1", False, "a")
    world.say(BROKEN, activation, token, "R1")
    world.die("R2")
    assert pending(world) == ["a"]
    world.die("R8")
    assert pending(world) == []


def test_side_constraints_that_keep_the_living_from_it() -> None:
    robots: dict[str, dict[str, float]] = {robot: {"a": 1} for robot in ("R1", "R2", "R3")}
    apart = NeverTogether(("R1", "R2"), ())
    mission = make_mission(action("a"), robots, [task("a", ("a", 2, 2))])
    world = World(replace(mission, sections={SECTION: (apart,)}))
    world.die("R3")
    assert pending(world) == []
    world = World(replace(mission, sections={SECTION: (apart,)}))
    world.outcome(world.activation("a"), False, "R3")
    assert pending(world) == ["a"]


# -- becoming a fact --------------------------------------------------------------------------


class Clock:
    """What one robot makes of it."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.deadlines = Deadlines(300, 1_000)
        self.agreed = True

    def at(self, now_us: int) -> list[str]:
        """The facts that are due then."""
        plan, facts = self.world.plan(), self.world.facts
        found = self.deadlines.expired(plan, facts, now_us, lambda: self.agreed)
        return [name for name, _ in found]


def failing(**policies: Any) -> tuple[Clock, str]:
    """R1 has failed, R2 is dead; the name of its failure."""
    world = world_of("R1 R2", **policies)
    name = f"{records.LATCHED_FAILURE}/{world.activation('a')}"
    world.outcome(world.activation("a"), False, "R1")
    world.die("R2")
    return Clock(world), name


@pytest.mark.parametrize(("after_us", "limit_us"), [(None, 1_000), (1_700, 1_700)])
def test_a_latched_failure_is_written_after_its_time(after_us: int | None, limit_us: int) -> None:
    clock, name = failing(failure_after_us=after_us)
    assert clock.at(50) == []
    assert clock.deadlines.next_deadline_us() == 50 + limit_us
    assert clock.at(49 + limit_us) == []
    assert clock.at(50 + limit_us) == [name]
    clock.world.write("R1", (name, True))
    assert clock.at(51 + limit_us) == []
    assert clock.deadlines.next_deadline_us() is None
    assert clock.world.asked() == ["b"]


def test_time_begins_anew_when_the_plan_said_otherwise() -> None:
    clock, name = failing()
    assert clock.at(0) == []
    life = clock.world.facts.members["R2"].incarnation
    clock.world.alive["R2"] = life
    assert clock.at(600) == []
    assert clock.deadlines.next_deadline_us() is None
    clock.world.die("R2")
    assert clock.at(700) == []
    assert clock.at(1_699) == []
    assert clock.at(1_700) == [name]


def test_the_others_have_to_agree() -> None:
    clock, name = failing()
    clock.agreed = False
    assert clock.at(0) == []
    assert not clock.deadlines.awaits_agreement
    assert clock.at(1_000) == []
    assert clock.deadlines.awaits_agreement
    assert clock.deadlines.next_deadline_us() is None
    clock.agreed = True
    assert clock.at(1_001) == [name]
    assert not clock.deadlines.awaits_agreement


def test_who_was_away_begins_anew() -> None:
    clock, name = failing()
    assert clock.at(0) == []
    clock.deadlines.restart_agreed()
    assert clock.deadlines.next_deadline_us() is None
    assert clock.at(1_000) == []
    assert clock.at(2_000) == [name]


def test_what_is_blocked_fails_by_its_own_limit_whoever_agrees() -> None:
    clock, name = failing(blocked_fail_after_us=400)
    clock.agreed = False
    assert clock.at(0) == []
    assert clock.at(400) == [name]


# -- what a latched failure is worth -----------------------------------------------------------


def test_a_success_that_comes_in_beats_a_latched_failure_and_nothing_else_does() -> None:
    clock, name = failing()
    world = clock.world
    activation = world.activation("a")
    world.write("R1", (name, True))
    assert world.asked() == ["b"]
    world.alive["R2"] = world.facts.members["R2"].incarnation
    world.outcome(activation, False, "R2")
    assert world.asked() == ["b"]
    world.outcome(activation, True, "R2")
    assert world.asked() == []
    assert world.status.name == "SUCCESS"
