"""Jobs that are handed to real processes: what is acknowledged survives those that took it."""

from __future__ import annotations

import json
import signal
from unittest import mock

import anyio
import pytest

from mrbt_mesh.runtime.team_client import JobRefusedError, connect
from tests.support.paths import mission_file
from tests.support.team import Team

DELIVERIES = mission_file("deliveries")
COUNT = 12


def test_acknowledged_jobs_survive_the_robots_that_took_them(team: Team) -> None:
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")

    async def hand_in() -> list[tuple[str, str]]:
        async with connect(team.run_dir) as client:
            with pytest.raises(JobRefusedError, match="boxes is a whole number from 1 to 4"):
                await client.submit("deliver", "shelf_1", "dock_1", "9")
            with pytest.raises(JobRefusedError, match="safe 7: the mission has 6 robots"):
                await client.submit("inspect", "shelf_1", safe=7)
            handles = []
            for number in range(COUNT):
                name = f"job-{number}"
                job = await client.submit("inspect", f"shelf_{number % 6 + 1}", job_id=name, safe=4)
                handles.append(job)
                if number == 3:
                    # The one that all were handed to, in the moment of the acknowledgement.
                    team.signal(client.robots[0], signal.SIGKILL)
                if number == 6:
                    team.signal(client.robots[0], signal.SIGKILL)
                again = await client.submit("inspect", f"shelf_{number % 6 + 1}", job_id=name)
                assert again.id == name
            ends = [await job.done() for job in handles]
            return [(end.id, end.state) for end in ends]

    ends = anyio.run(hand_in)
    assert ends == [(f"job-{number}", "succeeded") for number in range(COUNT)], team.logs()
    listed = json.loads(team.mrbt("jobs", "--json"))
    assert {row["id"] for row in listed} == {f"job-{number}" for number in range(COUNT)}


def test_a_job_that_too_few_journals_hold_is_not_acknowledged(team: Team) -> None:
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    for robot in ("C1", "C2", "C3", "C4"):
        team.signal(robot, signal.SIGKILL)

    async def hand_in() -> None:
        async with connect(team.run_dir) as client:
            await client.submit("inspect", "shelf_1", job_id="few")

    with (
        mock.patch("mrbt_mesh.runtime.team_client.KEEP_TIMEOUT_S", 0.5),
        pytest.raises(
            TimeoutError, match=r"few is in the journals of . robots .*: submit it again"
        ),
    ):
        anyio.run(hand_in)


def test_a_team_that_is_killed_as_a_whole_goes_on_with_its_jobs(team: Team) -> None:
    team.hold("look")
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    name = team.mrbt("submit", "inspect", "shelf_2", "--id", "kept").strip()
    assert name == "kept"
    cancelled = team.mrbt("submit", "inspect", "shelf_3", "--id", "dropped", "--priority", "3")
    assert cancelled.strip() == "dropped"
    assert team.mrbt("job", "dropped", "cancel").strip() == "dropped: cancelled"
    times = ("--not-before", "+2", "--deadline", "+3")
    assert team.mrbt("submit", "inspect", "shelf_4", "--id", "late", *times).strip() == "late"
    team.wait_for_event("look", args=["shelf_2"])
    team.kill_all()
    team.end()
    team.release()
    team.up(DELIVERIES, "--continue", speed=20)
    team.wait_for_line("round 1 begins")

    async def wait() -> list[str]:
        async with connect(team.run_dir) as client:
            return [(await client.wait_for_end(name)).state for name in ("kept", "late")]

    assert anyio.run(wait) == ["succeeded", "expired"]
    states = {row["id"]: row["state"] for row in json.loads(team.mrbt("jobs", "--json"))}
    assert states == {"kept": "succeeded", "dropped": "cancelled", "late": "expired"}
