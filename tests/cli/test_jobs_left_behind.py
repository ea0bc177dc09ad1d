"""What is said of the jobs that a team has left, or goes on with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from mrbt_mesh.cli.jobs_left_behind import jobs_left_behind, open_jobs_text
from mrbt_mesh.cli.options import chosen_robots
from mrbt_mesh.cli.printing import plain
from mrbt_mesh.cli.views.summary_view import render_summary
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.observer.job_rows import JobRow
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import Team, new_run
from mrbt_mesh.sim import Fault, Kill, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Operate
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US
from tests.support import behaviour
from tests.support.behaviour import mission_of

S = 1_000_000
MISSION = mission_of(
    """
mission: m
ends: never
parameters: {behave: {once: {seconds: 5}, look: {seconds: 60}}}
local_tasks: {once: {}, look: {parameters: [where]}}
robot_types: {A: {capabilities: {once: 1}}, B: {capabilities: {look: 1}}}
robots: {A1: A, B1: B, B2: B}
global_tasks:
  once: {exclusive: true, needs: {once: {}}}
  look: {parameters: [where], needs: {look($where): {}}}
jobs:
  dose: {tree: once}
  inspect: {parameters: {where: [dock, gate, yard]}, tree: look($where)}
tree: {Jobs: {types: all}}
"""
)


def submit(name: str, kind: str, *arguments: str, not_before_us: int = 0) -> Fault:
    return Operate("B1", f"job/{name}", [kind, list(arguments), 0, not_before_us, 0, 0], "me")


@pytest.fixture(scope="module")
def result() -> SimulationResult:
    """A job is in doubt, since the robot that began it has died; others go on or wait."""
    later_us = LAUNCH_UNIX_US + 3_600 * S
    steps = [
        (2 * S, submit("doubt", "dose")),
        (2 * S, submit("plain", "inspect", "dock")),
        (2 * S, submit("later", "inspect", "gate", not_before_us=later_us)),
        (2 * S, submit("held", "inspect", "yard")),
        (2 * S + S // 10, Operate("B1", "job_hold/held", "held", "me")),
        (5 * S, Kill("A1")),
    ]
    return simulate(MISSION, behaviour.robot, seed=1, schedule=steps, timeout_us=10 * S)


def row(name: str, state: str) -> JobRow:
    return JobRow(name, "deliver", {}, state, "", 0, (), "anna")


def test_the_open_ones_are_named_some_of_many() -> None:
    assert open_jobs_text([row("a", "succeeded")]) == ""
    rows = [row("a", "succeeded"), row("b", "waiting"), row("c", "held"), row("d", "running")]
    assert open_jobs_text(rows) == "3 jobs go on: b, c, d (`mrbt job cancel ID` takes one back)"
    many = [row(str(number), "waiting") for number in range(9)]
    assert open_jobs_text(many).startswith("9 jobs go on: 0, 1, 2, 3, 4 and 4 more (")


def test_each_keeps_the_reason_that_is_its_own(
    result: SimulationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That nobody is there holds for all of them, and is said of none."""
    robots = chosen_robots("--robots", None, MISSION)
    info = new_run(MISSION, tmp_path / "m.yaml", robots, RobotOptions(beat_s=1.0, detection_s=5.0))
    info = replace(info, options=replace(info.options, run=result.observer.facts.run))
    run_dir = RunDir.create(tmp_path / "run", info, compile_mission(MISSION))
    kept = {"B1": tuple(result.observer.facts.map)}
    monkeypatch.setattr(Team, "journals", lambda *_: kept)
    found = {row.id: (row.state, row.why) for row in jobs_left_behind(run_dir, MISSION)}
    assert found.pop("doubt")[1].startswith("blocked: in doubt: nobody knows how far A1 got")
    state, why = found.pop("later")
    assert (state, why[:11]) == ("waiting", "not before ")
    assert found == {"plain": ("waiting", ""), "held": ("held", "")}


@pytest.mark.parametrize(("count", "text"), [(4, ", 4 jobs open"), (1, ", 1 job open"), (0, "")])
def test_the_summary_says_how_many_are_open(
    result: SimulationResult, count: int, text: str
) -> None:
    jobs = {kind: {**each, "open": 0} for kind, each in result.summary["jobs"].items()}
    jobs["inspect"]["open"] = count
    assert sum(each["open"] for each in result.summary["jobs"].values()) == 4
    first = plain(render_summary({**result.summary, "jobs": jobs}), 140).splitlines()[0]
    assert first.endswith(f"3 robots, 1 fault{text}")
