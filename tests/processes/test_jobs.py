"""Jobs that are handed to real processes: what is acknowledged survives those that took it."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from unittest import mock

import anyio
import pytest

from mrbt_mesh.runtime.job_requests import JobRefusedError
from mrbt_mesh.runtime.team_client import connect
from tests.support.paths import mission_file
from tests.support.team import Team

DELIVERIES = mission_file("deliveries")
COUNT = 12


def test_many_jobs_are_handed_in_by_one_command(team: Team) -> None:
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    names = [f"job-{number}" for number in range(COUNT)]
    lines = [json.dumps({"type": "inspect", "arguments": ["shelf_1"], "id": n}) for n in names]
    wrong = json.dumps({"type": "paint"})
    refused = team.command("submit", "--stdin", given="\n".join([*lines, wrong]))
    assert (refused.returncode, refused.stdout) == (2, "")
    assert f"line {COUNT + 1}: no job type 'paint'" in refused.stderr
    assert json.loads(team.mrbt("jobs", "--json")) == []
    done = team.command("submit", "--stdin", given="\n".join(lines))
    assert (done.returncode, done.stdout.split()) == (0, names), done.stderr
    other = json.dumps({"type": "inspect", "arguments": ["shelf_2"], "id": names[0]})
    done = team.command("submit", "--stdin", "--json", given="\n".join([other, lines[1]]))
    assert done.returncode == 1
    first, second = map(json.loads, done.stdout.splitlines())
    assert (first["cause"], second["id"]) == ("conflict", names[1])


@pytest.mark.smoke
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
        mock.patch("mrbt_mesh.runtime.team_client.CALL_TIMEOUT_S", 2),
        pytest.raises(
            TimeoutError,
            match=r"few: nothing was written: 2 robots \(D1, D2\) would .* again, or ask for fewer",
        ),
    ):
        anyio.run(hand_in)


def test_commands_reach_a_team_whose_first_robot_is_frozen_and_ids_are_of_one_job(
    team: Team,
) -> None:
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    later = ("--not-before", "+3600", "--id", "one")
    assert team.mrbt("submit", "inspect", "shelf_2", *later).strip() == "one"
    assert team.mrbt("submit", "inspect", "shelf_2", *later).strip() == "one"
    for other in (("shelf_3", *later), ("shelf_2", *later, "--priority", "9")):
        refused = team.command("submit", "inspect", *other)
        assert refused.returncode == 2
        assert "another job of this id, one: inspect(shelf_2)" in refused.stderr
    team.signal("C1", signal.SIGSTOP)
    paused = team.mrbt("pause")
    assert "pause is the team's command" in paused
    assert team.mrbt("job", "hold", "one").strip() == "one: held"
    assert team.mrbt("job", "release", "one").strip() == "one: open"
    team.signal("C1", signal.SIGCONT)
    team.wait_until(lambda: len(team.robots()) == 6, "it is back")
    assert team.mrbt("job", "priority", "one", "7").strip() == "one: open"
    (row,) = json.loads(team.mrbt("jobs", "--json"))
    assert (row["state"], row["priority"]) == ("waiting", 7)
    noted = (team.run_dir / "commands.jsonl").read_text().splitlines()
    said = [(each["by"], each["command"]) for each in map(json.loads, noted)]
    words = ("hold one", "release one", "priority one 7")
    assert [each for each in said if each[0] == "mrbt job"] == [("mrbt job", w) for w in words]


def test_a_team_that_is_killed_as_a_whole_goes_on_with_its_jobs(team: Team) -> None:
    team.hold("look")
    team.up(DELIVERIES, speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    name = team.mrbt("submit", "inspect", "shelf_2", "--id", "kept").strip()
    assert name == "kept"
    cancelled = team.mrbt("submit", "inspect", "shelf_3", "--id", "dropped", "--priority", "3")
    assert cancelled.strip() == "dropped"
    assert team.mrbt("job", "cancel", "dropped").strip() == "dropped: cancelled"
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


SORTING = """
mission: sorting
program: sort.py
ends: never
local_tasks: {look: {parameters: [shelf], sets: [found]}, fetch: {parameters: [what]}, weigh: {}}
blackboard: {found: {values: [red, blue], per: job}, weight: {min: 0, max: 9}}
robot_types: {T: {capabilities: {look: 1, fetch: 1, weigh: 1}}}
robots: {R1: T, R2: T, R3: T}
global_tasks:
  look: {parameters: [shelf], needs: {look($shelf): {}}}
  get: {parameters: [what], needs: {fetch($what): {}}}
  weigh: {needs: {weigh: {}}, failure: paper}
jobs:
  sort: {parameters: {shelf: [a, b]}, tree: {Sequence: [look($shelf), get($found)]}}
  weigh: {tree: weigh}
tree: {Jobs: all}
"""
SORT = """
from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)


@robot.local_task
async def look(task: TaskContext, shelf: str) -> dict[str, str]:
    return {"found": {"a": "red", "b": "blue"}[shelf]}


@robot.local_task
async def fetch(task: TaskContext, what: str) -> None:
    pass


@robot.local_task
async def weigh(task: TaskContext) -> None:
    task.set_value("weight", 12)
"""


def test_what_the_first_task_of_a_job_finds_is_the_argument_of_its_second(
    team: Team, tmp_path: Path
) -> None:
    (tmp_path / "mission.yaml").write_text(SORTING, encoding="utf-8")
    (tmp_path / "sort.py").write_text(SORT, encoding="utf-8")
    team.up(tmp_path / "mission.yaml")
    team.wait_until(lambda: len(team.robots()) == 3, "all are there")

    async def hand_in() -> list[tuple[str, str]]:
        async with connect(team.run_dir) as client:
            handles = [await client.submit("sort", shelf, job_id=f"of-{shelf}") for shelf in "ab"]
            handles.append(await client.submit("weigh", job_id="heavy"))
            return [(end.state, end.why) for end in [await job.done() for job in handles]]

    *sorted_, (state, reason) = anyio.run(hand_in)
    assert sorted_ == [("succeeded", "")] * 2, team.logs()
    assert state == "failed"
    assert "weight is not set: it is a whole number from 0 to 9, not 12" in reason
    assert "sort.py" in reason
    fetched = {e["activation"]: e["args"] for e in team.events() if e["local_task"] == "fetch"}
    assert sorted(fetched.values()) == [["blue"], ["red"]]
    of_a = next(activation for activation in fetched if "of-a" in activation)
    assert fetched[of_a] == ["red"]
