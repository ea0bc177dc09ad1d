"""Honest runs in which the mission is revised: robots leave, the tree shrinks, plans are late."""

from __future__ import annotations

from pathlib import Path

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.recording.metadata import OBSERVER
from mrbt_mesh.sim import AgentOptions, simulate
from mrbt_mesh.sim.world.faults import Revise
from mrbt_mesh.views.replay.check_files import RunDirFiles
from mrbt_mesh.views.replay.verify import verify
from tests.support.keys import keys_of
from tests.support.recorded import read_all

FILE = """
mission: line
local_tasks: {weld: {parameters: [part], work: 2}}
robot_types: {arm: {capabilities: {weld: 1}}}
robots: {%s}
global_tasks: {join: {parameters: [part], needs: {weld($part): {min: 1}}}}
tree: {Parallel: [%s]}
"""
ALL = ("A1", "A2", "A3", "A4")
PROGRAM = RobotProgram(record_work=True)


@PROGRAM.local_task("*")
async def work(task: TaskContext, *_: str) -> None:
    await anyio.sleep(task.simulation.duration_s)


def mission(robots: tuple[str, ...], parts: int) -> Mission:
    listed = ", ".join(f"{robot}: arm" for robot in robots)
    tasks = ", ".join(f"join({part})" for part in range(1, parts + 1))
    return mission_from_yaml(FILE % (listed, tasks), "line.yaml", Path())


@pytest.mark.parametrize("delay_us", [None, 30_000], ids=["at once", "plans made apart"])
@pytest.mark.parametrize("parts", [3, 12], ids=["fewer tasks", "more tasks"])
def test_robots_leave_and_come_back(tmp_path: Path, delay_us: int | None, parts: int) -> None:
    keys = keys_of(*ALL, observer="eye")
    options = AgentOptions(plan_delay_us=delay_us, keys={**keys, OBSERVER: keys["eye"]})
    fewer, again = mission(("A1", "A2"), parts), mission(ALL, parts + 2)
    schedule = [
        (2_500_000, Revise("A1", compile_mission(fewer), True)),
        (5_200_000, Revise("A2", compile_mission(again), True)),
    ]
    result = simulate(
        mission(ALL, 8),
        PROGRAM,
        seed=3,
        schedule=schedule,
        agents=options,
        record=tmp_path,
        timeout_us=60_000_000,
    )
    assert result.result == "success"
    assert result.stops["A4"] == (0, "left")
    verdict = verify(read_all(tmp_path), keys["eye"].manifest)
    assert not verdict.findings, list(map(str, verdict.findings[:5]))
    assert not verdict.gaps, list(map(str, verdict.gaps[:5]))


def test_mission_and_revision_keep_their_names(tmp_path: Path) -> None:
    began, later = mission(ALL, 3), mission(ALL, 5)
    schedule = [(1_000_000, Revise("A1", compile_mission(later), True))]
    result = simulate(began, PROGRAM, seed=3, schedule=schedule, record=tmp_path)
    assert result.observer.facts.in_force.number == 1
    texts = [compile_mission(each) for each in (began, result.observer.facts.in_force)]

    def verified(**missions: str) -> list[str]:
        files = RunDirFiles(missions={f"{name}.json": text for name, text in missions.items()})
        verdict = verify(read_all(tmp_path), None, files)
        notes = [each for each in verdict.notes if "revision.json" in each]
        return [*map(str, verdict.findings), *notes]

    assert verified(mission=texts[0], revision=texts[1]) == []
    (text,) = verified(mission=texts[1], revision=texts[0])
    assert text == "revision.json: it is not a later revision than mission.json"
    (text,) = verified(mission=texts[0])
    assert text.startswith("revision.json is missing")
