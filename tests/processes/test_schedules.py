"""Schedules of real processes: a robot is killed on its way, and the team makes a new one."""

from __future__ import annotations

import signal
from collections.abc import Callable

import anyio
import pytest

from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team_address import address_of
from mrbt_mesh.runtime.watcher import Watcher, watching
from tests.support.paths import mission_file
from tests.support.team import Team

DEPOT = mission_file("depot")


async def in_force(watcher: Watcher, holds: Callable[[Lookahead], bool]) -> Lookahead:
    """Wait until the team agrees on a plan with a schedule for which this holds."""
    while True:
        plan = watcher.observer.plan
        ahead = plan.ahead if plan is not None and watcher.observer.agreement else None
        if ahead is not None and ahead.schedule is not None and holds(ahead):
            return ahead
        await watcher.wait_for_change(0.1)


@pytest.mark.smoke
def test_a_robot_that_is_killed_on_its_way_is_left_out_of_a_new_schedule(team: Team) -> None:
    # Robots set out, but do not get anywhere.
    team.hold("C1", "C2", "C3", "S1")
    team.up(DEPOT)
    team.wait_for_event("clear")

    async def kill_one() -> tuple[str, str]:
        async with watching(address_of(RunDir(team.run_dir))) as watcher:
            facts = watcher.observer.facts
            await in_force(watcher, lambda ahead: any(map(facts.under_way, ahead.robots)))
            victim = next(robot for robot in sorted(facts.claims) if facts.under_way(robot))
            claim = facts.valid_claim(victim)
            assert claim is not None
            team.signal(victim, signal.SIGKILL)
            ahead = await in_force(watcher, lambda ahead: victim not in ahead.robots)
            schedule = ahead.schedule
            assert schedule is not None
            (step,) = (s for s in schedule if s.task == ahead.numbers[claim.activation])
            assert ahead.members(step) != []
            return victim, claim.activation

    victim, activation = anyio.run(kill_one)
    team.release()
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success"), team.logs()
    ends = [each for each in team.events() if each["outcome"] == "success"]
    assert victim not in {each["robot"] for each in ends}
    assert [each["activation"] for each in ends].count(activation) == 1
