"""Jobs' times where robots' wall clocks are off and jump."""

from __future__ import annotations

import pytest

from mrbt_mesh.sim import Fault, Kill, Restart, SetWallClock
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US
from tests.sim.test_run_jobs import run, works
from tests.sim.test_run_jobs import submit as submit_job
from tests.support.effort import seeds

S = 1_000_000
HOUR = 3_600 * S
ALL = ("A1", "A2", "B1")


def submit(robot: str, name: str, **times_s: float) -> Fault:
    """A job whose task takes too long for any deadline; times in seconds after the launch."""
    times = {f"{key}_us": LAUNCH_UNIX_US + round(at * S) for key, at in times_s.items()}
    return submit_job(robot, name, "deliver", "1", "dock_1", **times)


@pytest.mark.parametrize("seed", seeds(5))
@pytest.mark.parametrize("ahead_us", [HOUR, -HOUR])
def test_a_clock_that_jumps_expires_nothing_and_is_a_problem_until_it_is_set(
    seed: int, ahead_us: int
) -> None:
    steps = [
        (3.0, submit("A1", "later", not_before=12)),
        (3.0, submit("B1", "never", not_before=29, deadline=30)),
        (5.0, SetWallClock("A2", ahead_us)),
    ]
    result, ends = run(*steps, seconds=28, seed=seed)
    assert ends["later"][0] == "succeeded"
    assert min(float(t) for t, *_ in works(result)) > 12
    problems = {r: dict(p) for r, p in result.observer.facts.problems.items() if any(p.values())}
    side = "ahead of" if ahead_us > 0 else "behind"
    assert problems.keys() == {"A2"}
    assert problems["A2"]["clock"].startswith(f"its clock is 3600 s {side} the team's")
    result, ends = run(*steps, (26.0, SetWallClock("A2", 0)), seconds=40, seed=seed)
    assert ends["never"][0] == "expired"
    assert not any(any(p.values()) for p in result.observer.facts.problems.values())


@pytest.mark.parametrize("seed", seeds(5))
def test_the_one_that_is_left_still_knows_that_its_clock_is_wrong(seed: int) -> None:
    deaths = [(10.0, Kill("A1")), (14.0, Kill("B1"))]
    steps = [(3.0, submit("A1", "a", not_before=60, deadline=70)), (5.0, SetWallClock("A2", HOUR))]
    assert run(*steps, *deaths, seconds=40, seed=seed)[1] == {}
    corrected = (30.0, SetWallClock("A2", 0))
    _, ends = run(*steps, *deaths, corrected, seconds=75, seed=seed)
    assert ends["a"][0] == "expired"


@pytest.mark.parametrize("seed", seeds(5))
def test_deadlines_hold_after_the_restart_of_the_whole_team(seed: int) -> None:
    steps = [(3.0, submit("A1", "a", not_before=29, deadline=30))]
    steps += [(6.0, Kill(robot)) for robot in ALL] + [(20.0, Restart(robot)) for robot in ALL]
    assert run(*steps, seconds=29, seed=seed)[1] == {}
    assert run(*steps, seconds=31, seed=seed)[1]["a"][0] == "expired"


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(5))
def test_clocks_that_drift_are_no_problem_until_they_are_a_second_apart(seed: int) -> None:
    steps = [(0.0, SetWallClock("B1", 0, drift_ppm=900))]
    for seconds, off in ((900, False), (1_300, True)):
        result, _ = run(*steps, seconds=seconds, seed=seed)
        assert any(result.observer.facts.problems.get("B1", {}).values()) is off
