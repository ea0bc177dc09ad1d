"""mrbt recording replay: one state as JSON, and what happened as lines."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from xml.etree import ElementTree

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


def test_timeline_events_and_assignments_as_files(folder: Path, tmp_path: Path) -> None:
    file = str(folder / "run.mcap")
    to = str(tmp_path / "files")
    code, output, _ = recording("replay", file, "--export", to, "--json")
    assert code == 0
    svg, events, assignments = (Path(path) for path in json.loads(output)["written"])
    assert svg.name == "explore-sim3-timeline.svg"
    drawn = ElementTree.parse(svg).getroot()
    titles = [each.text or "" for each in drawn.iter("{http://www.w3.org/2000/svg}title")]
    assert titles[0] == "explore, run sim3"
    with assignments.open(newline="") as opened:
        rows = list(csv.DictReader(opened))
    assert len(rows) == sum("explore(" in title for title in titles) > 0
    assert {row["end"] for row in rows} <= {"done", "dropped"}
    lines = recording("replay", file)[1].splitlines()
    with events.open(newline="") as opened:
        texts = [row["text"] for row in csv.DictReader(opened)]
    assert texts == [line.split(maxsplit=1)[1] for line in lines]
    assert b"\r\n" in events.read_bytes(), "as RFC 4180 has it"
    svg.unlink()
    Path(to, svg.name).mkdir()
    refused_because = refused(recording("replay", file, "--export", to))
    assert f"--export {to}: cannot be written" in refused_because
    assert "shows nothing" in refused(recording("replay", file, "--export", to, "--at", "1"))
