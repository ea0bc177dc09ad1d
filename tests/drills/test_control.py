"""What may be commanded by hand, and what is said when that cannot be done."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import anyio
import pytest

from mrbt_mesh.core.agent.operator_messages import CommandStep
from mrbt_mesh.core.facts.records import OperatorCommand
from mrbt_mesh.core.facts.store import Entry, Version
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.drills import watched as drills_watched
from mrbt_mesh.drills.control import CommandError, Control
from mrbt_mesh.drills.model import StepModel
from mrbt_mesh.runtime.run_dir import RunDir
from tests.support.watched import COVER, WELD, watched


class Watcher:
    """Remembers the words that robots are told."""

    def __init__(self, team: Sequence[str] = WELD) -> None:
        _, self.observer = watched(team)
        self.said: list[tuple[str, str, str]] = []
        self.answer = True, "done"
        self.commanded: dict[str, tuple[str, Any]] = {}

    async def command(self, robot: str, command: str, argument: str = "") -> tuple[bool, str]:
        self.said.append((robot, command, argument))
        return self.answer

    def make_command(self, name: str, value: Any, operator: str, version: Version) -> Entry:
        return make_command(name, value, operator, version, "r", None)

    async def operate(
        self, robot: str, step: CommandStep, entry: Entry, passes_on: bool
    ) -> dict[str, Any] | None:
        command = entry.record
        assert isinstance(command, OperatorCommand)
        self.commanded[robot] = entry.name, command.value
        if robot == "A":
            return None
        return {"taken": True, "kept": True, "newest": None, "stamp": 1, "state": {}}


def control(watcher: Watcher) -> Control:
    """Of a team on the network: none of its processes is here."""
    return Control(watcher, None, None)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ({"act": "lose", "robot": "B", "local_task": "weld"}, ("B", "fault", "weld")),
        ({"act": "restore", "robot": "B"}, ("B", "restore", "all")),
        ({"act": "leave", "robot": "B"}, ("B", "leave", "")),
    ],
)
async def test_words_go_to_robots(command: Any, said: tuple[str, str, str]) -> None:
    watcher = Watcher()
    assert await control(watcher).carry_out(command) == "done"
    assert watcher.said == [said]


@pytest.mark.parametrize(
    ("act", "commanded"),
    [
        ("pause", ("paused", "pause")),
        ("resume", ("paused", "resume")),
        ("abort", ("aborted", True)),
    ],
)
async def test_commands_to_the_team_go_to_all_robots_and_name_those_that_are_silent(
    act: str, commanded: tuple[str, Any]
) -> None:
    watcher = Watcher(COVER)
    robots = watcher.observer.mission.robots
    text = await control(watcher).carry_out({"act": act})
    assert text == f"{act} is the team's command; A has not answered"
    assert watcher.commanded == dict.fromkeys(robots, commanded)


async def test_what_a_robot_refuses_is_told() -> None:
    watcher = Watcher()
    watcher.answer = False, "B has no such capability"
    with pytest.raises(CommandError, match="no such capability"):
        await control(watcher).carry_out({"act": "lose", "robot": "B", "local_task": "x"})


@pytest.mark.parametrize(
    "command",
    [
        None,
        7,
        [],
        {},
        {"act": "format"},
        {"act": "kill"},
        {"act": "kill", "robot": 7},
        {"act": "kill", "robot": "Z"},
        {"act": "kill", "robot": "A"},
        {"act": "lose", "robot": "../A"},
        {"act": "drill", "label": "kill_at_work"},
        {"act": ["pause"]},
    ],
)
async def test_what_is_no_command_or_not_for_this_team(command: Any) -> None:
    watcher = Watcher()
    with pytest.raises(CommandError):
        await control(watcher).carry_out(command)
    assert watcher.said == []


def test_only_what_can_be_done_is_offered() -> None:
    offers = control(Watcher()).offers()
    assert offers["robot"].keys() == {"lose", "restore", "leave"}
    assert offers["team"].keys() == {"pause", "resume", "abort"}
    assert not offers["drills"]


class FullDisk:
    """A team of this machine, whose robots cannot be started again."""

    def __init__(self, folder: Path) -> None:
        self.run_dir = RunDir(folder)

    def process(self, robot: str) -> None:
        return None

    async def start(self, robot: str) -> None:
        raise OSError(28, "No space left on device")


async def test_what_the_system_refuses_is_told(tmp_path: Path) -> None:
    refusing = Control(Watcher(), FullDisk(tmp_path), None)  # type: ignore[arg-type]
    with pytest.raises(CommandError, match="No space left"):
        await refusing.carry_out({"act": "join", "robot": "A"})


async def test_a_drill_that_the_system_refuses_ends_and_nothing_else(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    step = StepModel.model_validate({"after": 0, "restart": "A"})
    found = SimpleNamespace(label="one", steps=[step])
    monkeypatch.setattr(drills_watched, "fitting_drills", lambda mission: {"one": found})
    watcher = Watcher()
    async with anyio.create_task_group() as group:
        refusing = Control(watcher, FullDisk(tmp_path), group)  # type: ignore[arg-type]
        assert await refusing.carry_out({"act": "drill", "label": "one"}) == (
            "one: 1 steps, each at its moment"
        )
    (command,) = (tmp_path / "commands.jsonl").read_text().splitlines()
    assert json.loads(command)["by"] == "a view: drill"
    assert "drill one: [Errno 28] No space left on device" in watcher.observer.record.timeline[-1]


async def test_a_drill_file_that_is_wrong_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "wrong.yaml").write_text("name: [")
    monkeypatch.setattr(drills_watched, "drill_folder", lambda: tmp_path)
    wrong = Control(Watcher(), FullDisk(tmp_path), None)  # type: ignore[arg-type]
    with pytest.raises(CommandError, match=r"wrong\.yaml"):
        await wrong.drills()
