"""A robot's log: JSON lines in its file, readable ones on a terminal."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from mrbt_mesh.runtime import log
from mrbt_mesh.runtime.log import configure_log, robot_logger
from mrbt_mesh.runtime.run_dir import RunDir

TIME = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z"


@pytest.fixture(autouse=True)
def as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log, "_sink", log._sink)


def test_lines_of_json_hold_what_is_bound_and_what_is_said(tmp_path: Path) -> None:
    configure_log("A1", tmp_path)
    robot_logger("A1").bind(vehicle="7").warning("slow", seconds=0.5, what={1}, text="ä\n")
    (line,) = RunDir(tmp_path).log_path("A1").read_text().splitlines()
    found = json.loads(line)
    assert re.fullmatch(TIME, found.pop("timestamp"))
    assert found == {
        "robot": "A1",
        "vehicle": "7",
        "seconds": 0.5,
        "what": "{1}",
        "text": "ä\n",
        "event": "slow",
        "level": "warning",
    }


def test_that_it_hears_nobody_is_printed_as_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    configure_log("A1", tmp_path)
    robot_logger("A1").warning("no_other_robot_heard", reason="it hears nobody")
    robot_logger("A1").info("other", reason="quiet")
    assert capsys.readouterr() == ("A1: it hears nobody\n", "")
    assert len(RunDir(tmp_path).log_path("A1").read_text().splitlines()) == 2


def test_without_a_folder_lines_are_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    configure_log("A1", None)
    robot_logger("A1").error("stopped", reason="no \x1b room", code=2)
    robot_logger("A1").debug("quiet")
    first, second = capsys.readouterr().err.splitlines()
    assert re.fullmatch(
        rf"{TIME} \[error  \] stopped +robot=A1 reason='no \\x1b room' code=2", first
    )
    assert second.endswith("robot=A1")
