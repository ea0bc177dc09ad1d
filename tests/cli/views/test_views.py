"""What people see: status and summaries, drawn from simulated runs."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from mrbt_mesh.cli.commands.status import status_data
from mrbt_mesh.cli.launching import overload_text
from mrbt_mesh.cli.printing import Printable, plain
from mrbt_mesh.cli.views.marks import by_urgency
from mrbt_mesh.cli.views.status_view import render_status
from mrbt_mesh.cli.views.summary_view import capability_changes, render_summary
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.capacity import Machine, overload
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import ChangePerformance, Kill, Lose, SimulationResult, simulate
from tests.support import behaviour
from tests.support.behaviour import mission_of
from tests.support.paths import ROOT

REPAIR = ROOT / "examples" / "vehicle_repair" / "mission.yaml"
SECOND = 1_000_000
LOSE = Lose("A1", "do_diagnosis")


def run(
    until_s: float, *schedule: tuple[int, Kill | Lose | ChangePerformance], path: Path = REPAIR
) -> SimulationResult:
    """The repair until a moment in the middle of it."""
    mission = load_mission(path)
    program = load_program(mission.program or "")
    timeout_us = round(until_s * SECOND)
    return simulate(mission, program, seed=1, schedule=schedule, timeout_us=timeout_us)


def drawn(view: Printable, width: int = 140) -> str:
    return plain(view, width)


def line_of(text: str, part: str) -> str:
    return next(line for line in text.splitlines() if part in line)


@pytest.mark.parametrize(("cores", "memory_mb"), [(2, 24_000), (64, 1_000)])
def test_the_warning_names_figures_and_remedies_that_hold(cores: int, memory_mb: int) -> None:
    found = overload(90, 0.2, 1.0, Machine(cores, memory_mb))
    assert found is not None
    text = overload_text(found)
    assert f"90 robots are too many for this machine: about {found.carried} fit " in text
    assert f"{cores} core" in text
    assert f"at most {found.carried} robots (--robots)" in text
    assert "several machines (mrbt agent)" in text
    assert ("--beat" in text) == (found.limit == "processor")


def test_the_summary_tells_the_story_of_a_takeover() -> None:
    result = run(60.0, (7 * SECOND, Kill("A1")))
    assert result.result == "success"
    text = drawn(render_summary(result.summary))
    assert "mission succeeded" in text
    assert "1 fault" in text
    assert "A1 died" in text
    assert "dead" in line_of(text, "A1     A")


def test_bids_are_in_the_summary() -> None:
    mission = load_mission(REPAIR.parents[1] / "couriers" / "mission.yaml")
    program = load_program(mission.program or "")
    result = simulate(mission, program, seed=1)
    summary = drawn(render_summary(result.summary))
    assert "K4 -5.12, K1 -7.41, K2 -13, K3 -13.62" in line_of(summary, "deliver(bread)  ")


def test_the_status_shows_the_bounds_of_what_is_requested() -> None:
    # C1 dies with one of two frames to move; the screws of both are out.
    observer = run(8.0, (1 * SECOND, Kill("C1"))).observer
    address = SimpleNamespace(run_dir=None, keys=None)
    watcher = SimpleNamespace(observer=observer, address=address)
    data = status_data(cast("Any", watcher))
    (row,) = data["bounds"]
    assert row["local_task"] == "move_frame"
    assert (row["global_task"], row["lower"], row["upper"], row["robots"]) == (
        "remove_cover",
        2,
        2,
        [],
    )
    _, _, table = drawn(render_status(data)).partition("local task")
    assert table.splitlines()[1].split() == ["move_frame", "remove_cover", "2", "2", "nobody"]


def test_the_summary_and_the_status_tell_why_something_failed() -> None:
    """Of many, the summary names the first ones and the status the latest."""
    mission = load_mission(REPAIR.parents[1] / "tool_search" / "mission.yaml")
    program = load_program(mission.program or "")
    result = simulate(mission, program, seed=1)
    summary = drawn(render_summary(result.summary))
    assert " failed at search(1) for " in summary
    assert ": no tools in storage 1" in summary
    address = SimpleNamespace(run_dir=None, keys=None)
    data = status_data(cast("Any", SimpleNamespace(observer=result.observer, address=address)))
    assert {each["reason"] for each in data["failures"]} >= {"no tools in storage 1"}
    assert ": no tools in storage 1" in drawn(render_status(data))
    many = data["failures"][:1] * 25
    text = drawn(render_status(data | {"failures": many}))
    assert "5 earlier failures" in text
    assert text.count("no tools") == 20
    assert "and 5 other failures" in drawn(render_summary({**result.summary, "failures": many}))


def test_the_status_shows_the_blackboard_and_what_is_read_from_it() -> None:
    mission = mission_of(
        """
mission: m
parameters: {behave: {look: {values: {found: red}}, fetch: {seconds: 60}}}
local_tasks: {look: {sets: [found]}, fetch: {parameters: [what]}}
blackboard: {found: {values: [red, blue]}, never_set: {text: 9}}
robot_types: {T: {capabilities: {look: 1, fetch: 1}}}
robots: {R1: T}
global_tasks:
  look: {needs: {look: {}}}
  get: {parameters: [what], needs: {fetch($what): {}}}
tree: {Sequence: [look, get($found)]}
"""
    )
    result = simulate(mission, behaviour.robot, seed=1, timeout_us=5 * SECOND)
    address = SimpleNamespace(run_dir=None, keys=None)
    data = status_data(cast("Any", SimpleNamespace(observer=result.observer, address=address)))
    assert data["blackboard"] == {"found": "red"}
    assert data["robots"]["R1"]["values"] == {"found": "red"}
    text = drawn(render_status(data))
    assert "blackboard: found = red" in text
    assert "fetch(red)" in line_of(text, "R1 ")


def test_the_status_says_for_how_long_a_robot_is_at_work_and_whether_it_is_late(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mission = mission_of(
        """
mission: m
parameters: {behave: {fetch: {seconds: 60}}}
local_tasks: {fetch: {work: 4}}
robot_types: {T: {capabilities: {fetch: 1}}}
robots: {R1: T}
global_tasks: {get: {needs: {fetch: {}}}}
tree: get
"""
    )
    result = simulate(mission, behaviour.robot, seed=1, timeout_us=5 * SECOND)
    address = SimpleNamespace(run_dir=None, keys=None)
    watcher: Any = SimpleNamespace(observer=result.observer, address=address)
    span = result.observer.record.work_log.latest("R1")
    assert span is not None
    assert span.since_us is not None
    for now_s, text, is_overdue in ((12, "12 s of 4 s", False), (13, "13 s of 4 s", True)):
        now_us = span.since_us + now_s * SECOND
        monkeypatch.setattr("mrbt_mesh.runtime.fencing.boottime_us", lambda now_us=now_us: now_us)
        data = status_data(watcher)
        row = data["robots"]["R1"]
        assert (row["at_work_s"], row["expected_s"]) == (now_s, 4.0)
        assert row["is_overdue"] is is_overdue
        assert text in line_of(drawn(render_status(data)), "R1     T")
        assert any("is expected" in each["text"] for each in data["headline"]) is is_overdue


def test_the_status_shows_how_often_and_why_messages_are_refused() -> None:
    address = SimpleNamespace(run_dir=None, keys=None)
    watcher = SimpleNamespace(observer=run(2.0).observer, address=address)
    data = status_data(cast("Any", watcher))
    assert "has refused" not in drawn(render_status(data))
    few = {"B1: not signed": 3, "B2: said before": 4, "C1: not signed": 2}
    many = {f"B1: reason {number}": 9 - number for number in range(7)}
    text = drawn(render_status(data | {"refused": {"A1": few, "A2": many}}))
    assert line_of(text, "A1 has") == ("A1 has refused 9 messages: not signed (5); said before (4)")
    text = " ".join(text.split())
    assert "A2 has refused 42 messages: reason 0 (9);" in text
    assert "reason 4 (5); 2 other reasons" in text
    assert "not secure: nothing is signed" in text


def test_a_team_that_stands_by_shows_its_rounds() -> None:
    path = REPAIR.with_name("standing_by.yaml")
    calm, at_work, again = (run(until_s, path=path) for until_s in (3.0, 12.0, 33.0))
    assert "stood by: there was nothing to do" in drawn(render_summary(calm.summary))
    assert "mission not finished in time" in drawn(render_summary(at_work.summary))
    summary = drawn(render_summary(again.summary))
    assert "✔ stood by: 1 round, the last one succeeded; one is on its way" in summary
    assert line_of(summary, "4.19 s").split() == (
        ["1", "4.19", "s", "24.04", "s", "success", "A1,", "A2,", "B1,", "B2,", "C1,", "C2"]
    )
    assert "running" in line_of(summary, "30.09 s")


def test_what_a_robot_does_worse_stands_beside_what_it_has_lost() -> None:
    perform = [(2 * SECOND, ChangePerformance("A1", "replace_hw", 500_000)), (2 * SECOND, LOSE)]
    text = drawn(render_summary(run(4.0, *perform).summary))
    assert "lost do_diagnosis: injected" in line_of(text, " A1 ")
    assert "replace_hw 0.5" in text


def test_what_a_robot_cannot_use_yet() -> None:
    row = {
        "lost": {"go": "no map", "fetch": "no map", "look": ""},
        "pending": {"fly": "no server yet"},
    }
    assert capability_changes(row).plain.splitlines() == [
        "lost look",
        "lost fetch, go: no map",
        "cannot use fly now: no server yet",
    ]


def test_robots_in_trouble_come_first_then_those_at_work() -> None:
    idle = {"state": "alive", "lost": {}, "problems": [], "local_task": None}
    rows = {
        "A1": idle,
        "A2": idle | {"local_task": "explore"},
        "B1": idle | {"lost": {"explore": ""}, "local_task": "explore"},
        "B2": idle | {"problems": ["its journal is slow"]},
        "C1": idle | {"state": "suspect"},
        "C2": idle | {"state": "left"},
    }
    assert by_urgency(rows) == ["B1", "B2", "C1", "A2", "A1", "C2"]
