"""Robots inside a program of one's own, over real sessions on this machine."""

from __future__ import annotations

import asyncio
import dataclasses
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import anyio
import anyio.abc
import pytest

import mrbt_mesh
from mrbt_mesh import (
    InputError,
    NotInTeamError,
    RobotOptions,
    RobotProgram,
    TaskContext,
    TeamMember,
    join_team,
)
from mrbt_mesh.runtime import log, team_member
from mrbt_mesh.runtime.team import free_endpoints
from tests.support.paths import mission_file

EXPLORE = mission_file("explore")
BOTH = ("R1", "R2")


def exploring(seconds: float = 0.0) -> RobotProgram:
    program = RobotProgram()

    @program.local_task("explore")
    async def explore(task: TaskContext, area: str) -> None:
        await asyncio.sleep(seconds)

    return program


def places(**more: Any) -> dict[str, RobotOptions]:
    """Where two robots are that find each other."""
    first, second = free_endpoints(2, "tcp")
    common: dict[str, Any] = {"insecure": True, "expect": BOTH, "beat_s": 0.05, **more}
    return {
        "R1": RobotOptions(**common, listen=[first]),
        "R2": RobotOptions(**common, listen=[second], connect=[first]),
    }


def alone(**more: Any) -> RobotOptions:
    (place,) = free_endpoints(1, "tcp")
    options: dict[str, Any] = {"insecure": True, "expect": ["R1"], "listen": [place], **more}
    return RobotOptions(**options)


async def test_two_robots_carry_a_mission_out_beside_other_tasks() -> None:
    where, ticks = places(), 0

    async def other_task() -> None:
        nonlocal ticks
        while True:
            await asyncio.sleep(0)
            ticks += 1

    loop, before = asyncio.get_running_loop(), [signal.getsignal(s) for s in (2, 15)]
    before_log = log._sink
    selector = loop._selector  # type: ignore[attr-defined]
    beside = asyncio.create_task(other_task())
    async with (
        join_team(EXPLORE, "R1", exploring(), where["R1"]) as a,
        join_team(EXPLORE, "R2", exploring(), where["R2"]) as b,
    ):
        await a.until_joined()
        await b.until_joined()
        await a.until(lambda: a.team == BOTH)
        assert (a.stopped, b.stopped) == (None, None)
        assert await asyncio.gather(a.until_ended(), b.until_ended()) == ["success"] * 2
        assert a.statuses == dict.fromkeys(("T_i", "T_A", "T_G", "T_Li"), "success")
        assert a.command == "resume"
        assert [signal.getsignal(s) for s in (2, 15)] == before
        assert log._sink is before_log
    assert (a.stopped, b.stopped) == ("left", "left")
    assert loop._selector is selector  # type: ignore[attr-defined]
    assert ticks > 0
    assert not beside.done()
    beside.cancel()


async def test_plan_and_work_can_be_read_and_the_robot_tells_conditions() -> None:
    where = places()
    async with (
        join_team(EXPLORE, "R1", exploring(60), where["R1"]) as a,
        join_team(EXPLORE, "R2", exploring(60), where["R2"]) as b,
    ):
        await a.until(lambda: a.works_on is not None and b.works_on is not None)
        assert a.agrees
        assert set(a.plan) == set(BOTH)
        assert a.plan["R1"] == a.works_on
        assert a.plan == b.plan
        assert not a.is_paused
        assert a.waiting == {}
        a.context.lose_capability("explore")
        await b.until(lambda: "R1" not in b.plan)
        # A member that leaves hands its work over while the other one is still there.
        await a.leave()
        await b.until(lambda: b.team == ("R2",))
        with pytest.raises(NotInTeamError, match="R1 is not a member any more: left"):
            await a.until_ended()


async def test_what_the_body_raises_comes_out_as_it_is_and_the_robot_leaves() -> None:
    found: list[TeamMember] = []

    async def body() -> None:
        async with join_team(EXPLORE, "R1", exploring(60), alone()) as member:
            found.append(member)
            await member.until_joined()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        await body()
    assert found[0].stopped == "left"


async def test_a_body_that_is_cancelled_leaves() -> None:
    found: list[TeamMember] = []

    async def body() -> None:
        async with join_team(EXPLORE, "R1", exploring(60), alone()) as member:
            found.append(member)
            await member.until(lambda: member.works_on is not None)
            joined.set()
            await asyncio.Event().wait()

    joined = asyncio.Event()
    task = asyncio.create_task(body())
    await joined.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert found[0].stopped == "left"


async def test_a_robot_that_ends_by_itself_does_not_end_the_program() -> None:
    async with join_team(EXPLORE, "R1", exploring(), alone(exit_when_done=True)) as member:
        while member.stopped is None:
            await member.changed()
        assert member.stopped == "mission success"
        assert member.result == "success"


async def test_of_two_robots_of_the_same_id_one_stops_and_says_why() -> None:
    where = places(expect=["R1"])
    async with (
        join_team(EXPLORE, "R1", exploring(60), where["R1"]) as first,
        join_team(EXPLORE, "R1", exploring(60), where["R2"]) as second,
    ):
        with pytest.raises(NotInTeamError, match=r"R1 is not a member any more: .* R1 "):
            await asyncio.gather(first.until(lambda: False), second.until(lambda: False))
        assert [first.stopped, second.stopped].count(None) == 1


async def test_a_loop_that_stood_still_fences_its_robot_off() -> None:
    """Its action does nothing more: another robot may have long taken over."""
    said: list[str] = []
    program, begun = RobotProgram(), asyncio.Event()

    @program.local_task("explore")
    async def explore(task: TaskContext, area: str) -> None:
        begun.set()
        try:
            while True:
                await asyncio.sleep(0.2)  # is due while the loop stands still
                said.append("step")
        except asyncio.CancelledError:
            said.append("cancelled")
            raise

    async with join_team(EXPLORE, "R1", program, alone(beat_s=0.05, detection_s=0.3)) as member:
        await begun.wait()
        said.clear()
        begun.clear()
        threading.Event().wait(1)
        said.append("stood still")
        await begun.wait()
        assert said[:2] == ["stood still", "cancelled"]
        assert member.stopped is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give either keys=FOLDER, made by `mrbt keys`, or insecure=True"),
        ({"keys": "k", "insecure": True}, "give either keys=FOLDER"),
        ({"insecure": True, "robot": "R9"}, "has no robot 'R9'"),
        ({"insecure": True, "robot": "no id"}, "robot id 'no id'"),
        ({"insecure": True, "program": RobotProgram()}, "no function for the local task explore"),
        ({"insecure": True, "program": "none.py"}, "there is no such file"),
        ({"insecure": True, "mission": "none.yaml"}, "none.yaml"),
        ({"insecure": True, "detection_s": 0.01}, "detection"),
        ({"insecure": True, "metrics_port": 1}, "metrics_port is None here .*, not 1"),
        ({"insecure": 1}, "insecure is True or False, not 1"),
        ({"keys": 1}, "keys is a path, not 1"),
        ({"insecure": True, "connect": "tcp/1.2.3.4:7447"}, "connect is a list of texts, not 'tcp"),
        ({"insecure": True, "expect": ["R1", 2]}, "expect is a list of texts, not"),
        ({"insecure": True, "beat_s": "fast"}, "beat_s is a number of seconds from 0.001 to"),
        ({"insecure": True, "beat_s": float("nan")}, "beat_s is a number of seconds"),
        ({"insecure": True, "gather_s": -1}, "gather_s is a number of seconds from 0 to 86400"),
        ({"insecure": True, "speed": 0}, "speed is a number from 0.01 to 1000, not 0"),
        ({"insecure": True, "speed": True}, "speed is a number from 0.01 to 1000, not True"),
        ({"insecure": True, "transport": "wird"}, "transport is 'wired' or 'wireless', not 'wird'"),
        ({"insecure": True, "transport": None}, "transport is 'wired' or 'wireless', not None"),
        ({"insecure": True, "type": 3}, "type is a text, not 3"),
        ({"insecure": True, "expect": ["a b"]}, "is not a robot's id"),
        ({"insecure": True, "run_dir": EXPLORE / "x"}, "mission.yaml/x: cannot be written"),
    ],
)
async def test_what_is_wrong_is_told_before_the_body(options: Any, message: str) -> None:
    given = {"mission": EXPLORE, "robot": "R1", "program": exploring()}
    named = {name: options.pop(name, value) for name, value in given.items()}
    with pytest.raises(InputError, match=message):
        async with join_team(**named, options=RobotOptions(**options)):
            pytest.fail("the body runs")


async def test_a_session_that_cannot_be_opened_is_told_before_the_body() -> None:
    async with join_team(EXPLORE, "R1", exploring(60), (place := alone())):
        with pytest.raises(InputError):
            async with join_team(EXPLORE, "R2", exploring(), place):
                pytest.fail("the body runs")


async def test_a_robot_that_breaks_is_told_to_who_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    async def broken(driver: Any) -> None:
        driver.begun.set()
        raise ZeroDivisionError("bug")

    monkeypatch.setattr(team_member.Driver, "run_as_guest", broken)

    async def body() -> None:
        async with join_team(EXPLORE, "R1", exploring(), alone()) as member:
            with pytest.raises(NotInTeamError, match="it broke"):
                await member.until(lambda: False)

    with pytest.raises(ZeroDivisionError, match="bug"):
        await body()


async def test_a_journal_lets_it_come_back(tmp_path: Path) -> None:
    """What it has done it does not do again."""
    done: list[str] = []
    program = RobotProgram(record_work=True)

    @program.local_task("explore")
    async def explore(task: TaskContext, area: str) -> None:
        done.append(area)

    place = alone(run_dir=tmp_path)
    for _ in range(2):
        async with join_team(EXPLORE, "R1", program, place) as member:
            assert await member.until_ended() == "success"
    assert sorted(done) == sorted(set(done))
    lines = (tmp_path / "events.jsonl").read_text().splitlines()
    assert len(lines) == 2 * len(done)


def python(text: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", text]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def test_a_program_that_has_joined_ends_by_itself() -> None:
    (place,) = free_endpoints(1, "tcp")
    done = python(f"""
import asyncio, mrbt_mesh
robot = mrbt_mesh.RobotProgram()

@robot.local_task("explore")
async def explore(area): ...

async def main():
    options = mrbt_mesh.RobotOptions(insecure=True, listen=[{place!r}], expect=["R1"])
    async with mrbt_mesh.join_team({str(EXPLORE)!r}, "R1", robot, options) as member:
        print(await member.until_ended())

asyncio.run(main())
print("after")
""")
    assert (done.returncode, done.stdout.split()) == (0, ["success", "after"]), done.stderr


def test_importing_the_package_loads_nothing_of_it() -> None:
    done = python("import sys, mrbt_mesh; print(*sorted(n.partition('.')[0] for n in sys.modules))")
    assert {"zenoh", "anyio", "asyncio", "msgpack", "pydantic"}.isdisjoint(done.stdout.split())
    assert all(hasattr(mrbt_mesh, name) for name in mrbt_mesh.__all__)
    with pytest.raises(AttributeError, match="no attribute 'join_teams'"):
        getattr(mrbt_mesh, "join_teams")  # noqa: B009


def test_without_asyncio_it_says_so() -> None:
    """As in a program of trio: no loop of asyncio's runs."""
    entering = join_team(EXPLORE, "R1", exploring(), RobotOptions(insecure=True)).__aenter__()
    with pytest.raises(InputError, match="needs asyncio"):
        entering.__await__().send(None)


def test_in_a_loop_without_a_selector_it_says_so_before_anything_begins() -> None:
    """As in a program of uvloop."""

    async def enter() -> None:
        async with join_team(EXPLORE, "R1", exploring(), RobotOptions(insecure=True)):
            raise AssertionError("it has begun")

    loop = asyncio.new_event_loop()
    selector, loop._selector = loop._selector, None  # type: ignore[attr-defined]
    try:
        entering = enter()
        asyncio._set_running_loop(loop)
        with pytest.raises(InputError, match="cannot fence itself off") as error:
            entering.send(None)
    finally:
        asyncio._set_running_loop(None)
        loop._selector = selector  # type: ignore[attr-defined]
        loop.close()
    assert error.value.__cause__ is error.value.__context__ is None


def test_every_option_is_checked() -> None:
    assert team_member._EXPECTED.keys() == {each.name for each in dataclasses.fields(RobotOptions)}


def test_a_program_of_anyio_joins_and_cancels_as_it_is_used_to() -> None:
    """The member waits in scopes and task groups of anyio, on asyncio."""
    found: list[TeamMember] = []

    async def take_part(*, task_status: anyio.abc.TaskStatus[None]) -> None:
        async with join_team(EXPLORE, "R1", exploring(60), alone()) as member:
            found.append(member)
            with anyio.move_on_after(0.1) as scope:
                await member.until(lambda: False)
            assert scope.cancelled_caught
            await member.until(lambda: member.works_on is not None)
            task_status.started()
            await anyio.sleep_forever()

    async def main() -> None:
        async with anyio.create_task_group() as group:
            await group.start(take_part)
            assert found[0].stopped is None
            group.cancel_scope.cancel()

    anyio.run(main)
    assert found[0].stopped == "left"
