"""What was recorded keeps its times, whatever the wall clock was set to meanwhile."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.summary import run_summary
from mrbt_mesh.recording.folder import observer_file, robot_files
from mrbt_mesh.recording.reader import Recording, RecordingError, open_recording
from mrbt_mesh.runtime import past
from mrbt_mesh.sim import Kill, Restart, Schedule, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Operate, Revise
from tests.support.recorded import record_example
from tests.support.runs import example


@pytest.mark.parametrize(
    ("clock", "is_kept"), [("this one", True), ("another", False), ("", False)]
)
def test_times_of_the_same_clock_are_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: str, is_kept: bool
) -> None:
    """A recording of another boot or machine is placed by the wall clock."""
    record_example(tmp_path, "explore", 1, [(2_000_000, Kill("R1"))])

    def opened(path: Path) -> Recording:
        recording = open_recording(path)
        return replace(recording, metadata=replace(recording.metadata, clock=clock))

    monkeypatch.setattr(past, "open_recording", opened)
    monkeypatch.setattr("mrbt_mesh.runtime.process_identity.clock_id", lambda: "this one")
    monkeypatch.setattr(past, "_epoch_us", lambda: 7_200_000_000)
    mission, _ = example("explore")
    timing = open_recording(next(tmp_path.glob("**/*.mcap"))).metadata.timing
    observer = Observer(mission, "sim1", timing, default_solver)
    try:
        past.tell_past(observer, tmp_path, 0.0, ())
    except RecordingError:
        pytest.fail("it was recorded whole")
    (fault,) = observer.record.major
    assert (fault.at_us == pytest.approx(2_000_000, abs=100_000)) is is_kept


FILE = """
mission: line
ends: never
local_tasks: {weld: {parameters: [part], work: %d}}
robot_types: {arm: {capabilities: {weld: 1}}}
robots: {%s}
global_tasks: {join: {parameters: [part], needs: {weld($part): {min: 1}}}}
jobs: {joint: {parameters: {part: {min: 1, max: 9}}, tree: join($part)}}
tree: {Jobs: all}
"""
PROGRAM = RobotProgram(record_work=True)
S = 1_000_000


@PROGRAM.local_task("weld")
async def weld(task: TaskContext, _: str) -> None:
    await anyio.sleep(task.simulation.duration_s)


def line(work: int, *robots: str) -> Mission:
    listed = ", ".join(f"{robot}: arm" for robot in robots)
    return mission_from_yaml(FILE % (work, listed), "line.yaml", Path())


def submit(name: str) -> Operate:
    return Operate("A2", f"job/{name}", ["joint", ["1"], 0, 0, 0, 0], "me")


def recorded(folder: Path, *schedule: tuple[float, Any]) -> SimulationResult:
    """A team of A1, A2 and A3, of which A3 dies at work."""
    steps: Schedule = [(round(at_s * S), each) for at_s, each in schedule]
    return simulate(
        line(4, "A1", "A2", "A3"),
        PROGRAM,
        seed=1,
        schedule=steps,
        record=folder,
        timeout_us=40 * S,
    )


def rounded(found: Any) -> Any:
    """Plain data with times in whole seconds: a robot knows a little sooner than an observer."""
    if isinstance(found, dict):
        return {key: rounded(value) for key, value in found.items()}
    if isinstance(found, list):
        return [rounded(each) for each in found]
    return round(found) if isinstance(found, float) else found


TOLD = ("rounds", "faults", "jobs", "global_tasks", "blocked")


@pytest.mark.parametrize("by", ["observer", "robots"])
@pytest.mark.parametrize("revised_s", [(20.0,), (9.0, 20.0)], ids=["once", "twice"])
def test_what_was_before_a_revision_is_told_too(
    tmp_path: Path, by: str, revised_s: tuple[float, ...]
) -> None:
    """Who comes late knows the last revision; the recordings begin with the first mission, or with
    one that was in force when a robot came back.
    """
    revisions = (
        (at_s, Revise("A1", compile_mission(line(5 + number, "A1", "A2", "A3")), True))
        for number, at_s in enumerate(revised_s)
    )
    result = recorded(
        tmp_path,
        *((2.3, submit(name)) for name in ("one", "two", "three")),
        (5.3, Kill("A3")),
        *revisions,
        *([(26.3, Restart("A3"))] if len(revised_s) > 1 else []),
        (30.3, submit("four")),
    )
    last = result.observer.facts.in_force
    assert last.number == len(revised_s)
    timing = open_recording(observer_file(tmp_path)).metadata.timing
    if by == "robots":
        observer_file(tmp_path).unlink()
    observer = Observer(last, "sim1", timing, default_solver)
    past.tell_past(observer, tmp_path, 0.0, ())
    assert not [text for _, text in observer.record.timeline if "not known" in text]
    assert observer.facts.in_force == last
    assert observer.record.started_us is not None
    ended_us = observer.record.started_us + round(result.summary["duration_s"] * S)
    found = run_summary(observer, "ended", ended_us)
    assert [(each["robot"], each["at_s"] > 1) for each in found["faults"]] == [("A3", True)]
    for key in TOLD:
        assert rounded(found[key]) == rounded(result.summary[key]), key


def test_robots_that_a_revision_removes_have_left_for_those_who_come_late(tmp_path: Path) -> None:
    """Also where the recordings of those that stay are all that is there."""
    fewer = Revise("A1", compile_mission(line(4, "A1", "A2")), True)
    result = recorded(tmp_path, (2.3, submit("one")), (12.0, fewer))
    last = result.observer.facts.in_force
    timing = open_recording(observer_file(tmp_path)).metadata.timing
    observer_file(tmp_path).unlink()
    next(path for path in robot_files(tmp_path) if path.stem == "A3").unlink()
    observer = Observer(last, "sim1", timing, default_solver)
    until_us = past.tell_past(observer, tmp_path, 0.0, ())
    assert until_us is not None
    found = run_summary(observer, "ended", until_us)
    assert (found["faults"], found["robots"]["A3"]["state"]) == ([], "left")
    assert rounded(found["jobs"]) == rounded(result.summary["jobs"])
