"""mrbt recording replay: one state as JSON, and what happened as lines."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.command import EXPLORE, mrbt, refused


def recording(*arguments: str) -> tuple[int, str, str]:
    return mrbt("recording", *arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("replay") / "run"
    assert mrbt("sim", "run", EXPLORE, "--seed", "3", "--record", str(made))[0] == 0
    return made


def test_a_state_as_json(folder: Path) -> None:
    file = str(folder / "recordings" / "R1.mcap")
    code, output, _ = recording("replay", file, "--json")
    end = json.loads(output)
    assert (code, end["robot"], end["run"]) == (0, "R1", "sim3")
    assert end["at_s"] == end["ends_at_s"]
    assert end["plan"]["result"] == "success"
    early = json.loads(recording("replay", file, "--at", "1", "--json")[1])
    assert early["at_s"] == 1
    assert early["plan"]["result"] == "running"
    assert len(early["facts"]) <= len(end["facts"])
    assert early["action"]["event"] == "started"


def test_what_happened_as_lines(folder: Path) -> None:
    lines = recording("replay", str(folder / "run.mcap"))[1].splitlines()
    assert any("mission: success" in line for line in lines)
    later = recording("replay", str(folder / "run.mcap"), "--at", "1")[1].splitlines()
    assert later == [line for line in lines if float(line.split()[0]) >= 1]


@pytest.mark.parametrize("more", [("--json",), ()])
def test_a_time_behind_the_end(folder: Path, more: tuple[str, ...]) -> None:
    problems = refused(recording("replay", str(folder / "run.mcap"), "--at", "9999", *more))
    assert "--at 9999: the recording ends at" in problems


@pytest.mark.parametrize("option", [("--port", "8000"), ("--host", "::1")])
def test_options_of_the_page_need_a_page(folder: Path, option: tuple[str, ...]) -> None:
    assert "give --web as well" in refused(recording("replay", str(folder / "run.mcap"), *option))


def test_the_page_begins_within_the_recording(folder: Path) -> None:
    problems = refused(recording("replay", str(folder / "run.mcap"), "--web", "--at", "9999"))
    assert "--at 9999: the recording ends at" in problems


def test_no_orders_are_given_to_what_is_past(folder: Path) -> None:
    assert recording("replay", str(folder / "run.mcap"), "--web", "--control")[0] == 2
