"""A large team is started by portions: the next robots once those before are up."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import anyio
import pytest

from mrbt_mesh.runtime import team as module
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import Team

Step = Callable[[], None]
ROBOTS = ["R1", "R2"]


@pytest.fixture
def team(tmp_path: Path) -> Team:
    """What `Team` needs for it, without processes."""
    found = Team.__new__(Team)
    found.run_dir = RunDir(tmp_path)
    found.processes = {robot: SimpleNamespace(pid=0, returncode=None) for robot in ROBOTS}
    return found


def mark(team: Team, robot: str, at_ns: int) -> Step:
    """Its process says that it has begun, or, later, that its event loop turns."""

    def step() -> None:
        path = team.run_dir.path / f"{robot}.process"
        path.touch()
        os.utime(path, ns=(at_ns, at_ns))

    return step


def steps_taken(
    team: Team, before_ns: int, steps: list[Step], monkeypatch: pytest.MonkeyPatch
) -> int:
    """How many steps of a story it takes until the robots count as up."""
    taken = 0

    async def look(_: float) -> None:
        nonlocal taken
        if taken == len(steps):
            await anyio.sleep_forever()  # until the time is over
        steps[taken]()
        taken += 1

    monkeypatch.setattr(module.anyio, "sleep", look)
    anyio.run(team._until_up, ROBOTS, before_ns)
    return taken


def test_up_is_who_has_begun_and_then_marks_that_it_lives(
    team: Team, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = time.time_ns()
    story = [("R1", 1), ("R2", 2), ("R2", 3), ("R1", 4), ("R1", 5)]
    steps = [mark(team, robot, now_ns + at_ns * 1_000_000) for robot, at_ns in story]
    assert steps_taken(team, now_ns, steps, monkeypatch) == 4


def test_marks_of_a_life_before_do_not_count(team: Team, monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = time.time_ns()
    for robot in ROBOTS:
        mark(team, robot, now_ns - 5_000_000)()
    story = [("R1", -4), ("R2", -4), ("R1", 1), ("R2", 1), ("R1", 2), ("R2", 2), ("R2", 3)]
    steps = [mark(team, robot, now_ns + at_ns * 1_000_000) for robot, at_ns in story]
    assert steps_taken(team, now_ns, steps, monkeypatch) == 6


def test_one_that_has_ended_is_not_waited_for(team: Team, monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = time.time_ns()

    def end() -> None:
        team.processes["R2"] = SimpleNamespace(pid=0, returncode=2)  # type: ignore[assignment]

    steps = [mark(team, "R1", now_ns + 1), mark(team, "R1", now_ns + 2), end]
    assert steps_taken(team, now_ns, steps, monkeypatch) == 3


def test_nor_one_that_hangs(team: Team, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "UP_TIMEOUT_S", 0.05)
    assert steps_taken(team, time.time_ns(), [lambda: None] * 2, monkeypatch) == 2


def test_robots_that_refuse_without_a_word_are_named(team: Team) -> None:
    """On a full disk the message of a robot cannot be written."""
    for process in team.processes.values():
        process.returncode = module.REFUSED
    team.run_dir.output_path("R1").write_text("error: no such program\n")
    team.run_dir.output_path("R2").touch()
    first, second = team.refusals()
    assert first == "error: no such program"
    assert second.startswith("error: R2 ended with status 2 and could not write why to ")
    assert second.endswith("R2.out: is its disk full?")
