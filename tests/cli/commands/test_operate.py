"""Commands that act on a running team: what they refuse."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import anyio
import psutil
import pytest

from mrbt_mesh.cli.commands import operate
from mrbt_mesh.core.membership.peer import State
from tests.support.command import done, mrbt, refused
from tests.support.run_dirs import a_run


def test_a_robot_that_runs_is_not_joined_and_a_frozen_one_is_to_be_thawed(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        run_dir = a_run(tmp_path / "run", {"R1": process.pid}).path
        join = ("join", "R1", "--run-dir", str(run_dir))
        said = refused(mrbt(*join))
        assert f"R1 is already running (pid {process.pid}): stop it first" in said
        done(mrbt("freeze", "R1", "--run-dir", str(run_dir)))
        while psutil.Process(process.pid).status() != psutil.STATUS_STOPPED:
            time.sleep(0)
        said = refused(mrbt(*join))
        assert f"(pid {process.pid}) and frozen: `mrbt thaw R1` lets it go on" in said
        process.kill()


class Leaving:
    """A watcher of a robot whose answer is lost, and which is seen to leave, or not."""

    def __init__(self, *seen: State) -> None:
        self.seen = list(seen)
        self.observer = self

    def robot_state(self, _: str) -> State:
        return self.seen[0]

    async def wait_for_change(self, timeout_s: float) -> None:
        await anyio.sleep(timeout_s / 100)
        self.seen.pop(0)

    async def command(self, *_: str) -> tuple[bool, str]:
        return False, "R1 does not answer"


@pytest.mark.parametrize("seen", [[State.LEFT], [State.ALIVE, State.SUSPECT, State.LEFT]])
def test_a_robot_that_has_left_need_not_have_answered(seen: list[State]) -> None:
    watcher: Any = Leaving(*seen)
    assert anyio.run(operate.robot_said, watcher, "R1", "leave", "") == "R1 has left"


@pytest.mark.parametrize("command", ["leave", "return"])
def test_a_robot_that_stays_and_does_not_answer_is_named(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operate, "LEFT_S", 0)
    watcher: Any = Leaving(*[State.ALIVE] * 9)
    with pytest.raises(SystemExit) as end:
        anyio.run(operate.robot_said, watcher, "R1", command, "")
    assert end.value.code == 1
