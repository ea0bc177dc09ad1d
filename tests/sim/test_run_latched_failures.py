"""A robot has failed, and who could still try is gone: the alternative gets its turn."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.sim import (
    Block,
    Kill,
    Lose,
    NetworkKnobs,
    Restart,
    Restore,
    Schedule,
    SimulationResult,
    Unblock,
    partition,
    simulate,
)
from tests.support import behaviour
from tests.support.behaviour import ends, mission_of, starts

S = 1_000_000
# From a kill until the others know (at most), and from then until the failure is latched.
DETECTED_S, AGREED_S = 1.0, 1.0

HEAD = """
mission: latched_failures
local_tasks: {a: {}, b: {}, c: {}}
robot_types: {T: {capabilities: {}}}
"""


def robots(**able: str) -> str:
    """robots(R1="a b"): one line of a mission file."""
    entries = []
    for name, tasks in able.items():
        values = ", ".join(f"{local_task}: 1" for local_task in tasks.split())
        entries.append(f"{name}: {{type: T, capabilities: {{{values}}}}}")
    return f"robots: {{{', '.join(entries)}}}\n"


def run(
    text: str, schedule: Schedule = (), expect: str = "success", seconds: int = 30
) -> SimulationResult:
    """Simulate; no invariant may break on the way."""
    result = simulate(
        mission_of(HEAD + text),
        behaviour.robot,
        seed=1,
        schedule=schedule,
        network=NetworkKnobs(),
        timeout_us=seconds * S,
    )
    assert not result.violations
    assert result.result == expect, result.summary["blocked"]
    return result


def fallback(
    policy: str = "", need: str = "{}", behave: str = "a@R1: {seconds: 2, fails: true}"
) -> str:
    """Fallback(a, b): R1 fails `a` after two seconds."""
    return f"""
parameters: {{behave: {{{behave}}}}}
global_tasks:
  A: {{needs: {{a: {need}}}{", " + policy if policy else ""}}}
  B: {{needs: {{b: {{}}}}}}
tree: {{Fallback: [A, B]}}
"""


THREE = robots(R1="a b", R2="a", R3="b")
# R2 is as slow as can be, so that nothing comes of what it begins.
SLOW = "a@R1: {seconds: 2, fails: true}, a@R2: {seconds: 99}, b: {seconds: 3}"
GONE: dict[str, Schedule] = {
    "killed before": [(1 * S, Kill("R2"))],
    "killed after": [(3 * S, Kill("R2"))],
    "lost before": [(1 * S, Lose("R2", "a"))],
    "lost after": [(3 * S, Lose("R2", "a"))],
}


def decided_s(result: SimulationResult) -> float:
    """When the alternative began."""
    return next(e["t"] for e in result.events if e["local_task"] == "b") - result.events[0]["t"]


@pytest.mark.parametrize("gone", GONE)
def test_the_alternative_has_its_turn_once_the_last_robot_that_could_try_is_gone(gone: str) -> None:
    result = run(THREE + fallback(behave=SLOW), GONE[gone])
    assert ("R1", "failure") in ends(result, "a")
    assert [end for _, end in ends(result, "b")] == ["success"]
    assert result.duration_us < (3 + DETECTED_S + AGREED_S + 4) * S


def test_a_robot_that_was_never_there_is_not_waited_for() -> None:
    result = run(robots(R1="a b", R3="b") + fallback(behave=SLOW))
    assert decided_s(result) == pytest.approx(2, abs=0.1)


def test_the_mission_says_for_how_long_the_team_must_agree() -> None:
    gone = [(1 * S, Kill("R2"))]
    usual = run(THREE + fallback(behave=SLOW), gone)
    later = run(THREE + fallback("failure: {after_s: 4.5}", behave=SLOW), gone)
    assert decided_s(usual) == pytest.approx(2 + AGREED_S, abs=0.2)
    assert decided_s(later) == pytest.approx(2 + 4.5, abs=0.2)


def test_a_robot_that_returns_in_time_is_tried() -> None:
    back: Schedule = [(1 * S, Lose("R2", "a")), (5 * S // 2, Restore("R2", "a"))]
    result = run(THREE + fallback(behave="a@R1: {seconds: 2, fails: true}"), back)
    assert starts(result) == [("R1", "a"), ("R2", "a")]


def test_time_begins_anew_when_a_robot_was_back_meanwhile() -> None:
    """Each time for less than the time that it takes."""
    flapping: Schedule = [
        (1 * S, Lose("R2", "a")),
        *((at * S // 10, Restore("R2", "a")) for at in (28, 38, 48)),
        *((at * S // 10, Lose("R2", "a")) for at in (30, 40, 50)),
    ]
    result = run(THREE + fallback(behave=SLOW), flapping)
    assert starts(result) == [("R1", "a"), *[("R2", "a")] * 3, ("R1", "b")]
    assert decided_s(result) == pytest.approx(5 + AGREED_S, abs=0.2)


@pytest.mark.parametrize(
    ("gone", "back"), [(Kill("R2"), Restart("R2")), (Lose("R2", "a"), Restore("R2", "a"))]
)
def test_a_latched_failure_holds_when_a_robot_returns(
    gone: Kill | Lose, back: Restart | Restore
) -> None:
    result = run(THREE + fallback(behave=SLOW), [(1 * S, gone), (5 * S, back)])
    assert starts(result) == [("R1", "a"), ("R1", "b")]
    assert [end for _, end in ends(result, "b")] == ["success"], "nor is the alternative cancelled"


def test_where_nobody_has_failed_the_request_is_blocked() -> None:
    gone: Schedule = [(1 * S, Kill("R1")), (1 * S, Kill("R2"))]
    run(THREE + fallback(behave=SLOW), gone, "blocked")
    result = run(THREE + fallback("blocked: {fail_after_s: 2}", behave=SLOW), gone)
    assert [robot for robot, task in starts(result) if task == "b"] == ["R3"]


def test_the_mission_says_for_all_tasks_when_what_is_blocked_fails() -> None:
    gone: Schedule = [(1 * S, Kill("R1")), (1 * S, Kill("R2"))]
    run("blocked: {fail_after_s: 2}\n" + THREE + fallback(behave=SLOW), gone)
    waits = fallback("blocked: wait", behave=SLOW)
    run("blocked: {fail_after_s: 2}\n" + THREE + waits, gone, "blocked")


# -- the paper's count ------------------------------------------------------------------------


TWO = fallback(
    "failure: paper", "{min: 1, max: 2}", "a@R1: {seconds: 9}, a: {seconds: 2, fails: true}"
)


def test_the_papers_count_is_of_robots_that_live() -> None:
    """R1 and R2 are assigned, R1 dies, R2 fails: 1 > 1 - 1."""
    result = run(robots(R1="a", R2="a", R3="b") + TWO, [(1 * S, Kill("R1"))])
    assert sorted(starts(result)) == [("R1", "a"), ("R2", "a"), ("R3", "b")]


def test_by_the_papers_count_a_living_robot_that_is_assigned_may_make_it_good() -> None:
    result = run(robots(R1="a", R2="a", R3="b") + TWO)
    assert ends(result, "a") == [("R2", "failure"), ("R1", "success")]
    result = run(robots(R1="a", R2="a", R3="b", R4="a") + TWO, [(1 * S, Kill("R1"))], seconds=60)
    assert [end for _, end in ends(result, "b")] == ["success"]
    assert ("R4", "a") in starts(result), "it took the place of R1"


# -- coalitions, exclusive tasks --------------------------------------------------------------


PAIR = fallback(
    "simultaneous: true", "{min: 2, max: 2}", "a@R1: {seconds: 2, fails: true}, a: {seconds: 9}"
)


def test_a_coalition_that_nobody_is_left_for() -> None:
    """R1 has failed, R2 is dead, and R4 alone is no coalition."""
    gone: Schedule = [(1 * S, Kill("R2"))]
    result = run(robots(R1="a", R2="a", R3="b", R4="a") + PAIR, gone)
    assert [end for _, end in ends(result, "b")] == ["success"]
    run(robots(R1="a", R2="a", R3="b", R4="a", R5="a") + PAIR, gone)


ONCE = fallback("exclusive: true", behave=SLOW)
FIVE = robots(R1="a b", R2="a", R3="b", R4="b", R5="b")


def test_an_exclusive_task_that_nobody_is_left_for() -> None:
    result = run(FIVE + ONCE, [(1 * S, Kill("R2"))])
    assert [end for _, end in ends(result, "b")] == ["success"]


def test_an_exclusive_task_in_doubt_is_for_the_operator() -> None:
    """R2 had begun: nobody knows how far it got."""
    result = run(FIVE + ONCE, [(4 * S, Kill("R2"))], "blocked")
    assert starts(result) == [("R1", "a"), ("R2", "a")]
    policy = "exclusive: true, in_doubt: retry"
    result = run(FIVE + fallback(policy, behave=SLOW), [(4 * S, Kill("R2"))])
    assert starts(result) == [("R1", "a"), ("R2", "a"), ("R1", "b")]


def test_a_minority_does_not_decide_about_an_exclusive_task() -> None:
    """R2, R4 and R5 may be at it. R1 was heard by a majority until it had failed."""
    cut = partition(["R1", "R3"], ["R2", "R4", "R5"])
    healed = [(2 * S, cut), (12 * S, Unblock(cut.links))]
    behave = "a@R1: {seconds: 2, fails: true}, a@R2: {seconds: 4}"
    result = run(FIVE + fallback("exclusive: true", behave=behave), healed)
    assert "b" not in {task for _, task in starts(result)}


# -- partitions -------------------------------------------------------------------------------


APART = """
parameters: {behave: {a@R1: {seconds: 1, fails: true}, a@R2: {seconds: 8}, b: {seconds: 20}}}
global_tasks: {A: {needs: {a: {}}}, B: {needs: {b: {}}}, C: {needs: {c: {}}}}
tree: {Sequence: [{Fallback: [A, B]}, C]}
"""


def test_a_success_from_a_healed_partition_beats_the_latched_failure() -> None:
    """R1 has failed, and R2 is at it, out of reach: R1's side decides that it has failed and begins
    the alternative. Then R2's success comes in."""
    cut = partition(["R2"], ["R1", "R3"])
    schedule = [(2 * S, cut), (12 * S, Unblock(cut.links))]
    result = run(robots(R1="a b", R2="a", R3="c") + APART, schedule, seconds=60)
    assert starts(result) == [("R1", "a"), ("R2", "a"), ("R1", "b"), ("R3", "c")]
    assert ends(result, "b") == [("R1", "cancel")]
    assert ends(result, "a")[-1] == ("R2", "success")
    facts = result.agents["R1"].view.facts
    (activation,) = (name for name, said in facts.activations.items() if said.has_latched_failure)
    assert facts.task_status("A", activation) is Status.SUCCESS


def test_a_latched_failure_that_comes_in_from_a_healed_partition_ends_the_try() -> None:
    """The same, healed while R2 is still at it: the latched failure holds for R2 too."""
    cut = partition(["R2"], ["R1", "R3"])
    schedule = [(2 * S, cut), (8 * S, Unblock(cut.links))]
    result = run(robots(R1="a b", R2="a", R3="c") + APART, schedule, seconds=60)
    assert ends(result, "a") == [("R1", "failure"), ("R2", "cancel")]
    assert ends(result, "b") == [("R1", "success")]


def test_a_false_suspicion_decides_nothing() -> None:
    """R1 does not hear R2 for most of a detection time, and R3 hears both."""
    link = frozenset({("R2", "R1"), ("R1", "R2")})
    schedule = [(1 * S, Block(link)), (9 * S, Unblock(link))]
    text = THREE + fallback(behave="a@R1: {seconds: 2, fails: true}, a@R2: {seconds: 6}")
    assert starts(run(text, schedule)) == [("R1", "a"), ("R2", "a")]
