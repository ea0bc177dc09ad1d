"""What is said of types of jobs: the same as of a mission with the tree of one job."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.analysis.tolerance import jobs
from mrbt_mesh.analysis.tolerance.analyse import analyse
from mrbt_mesh.analysis.tolerance.jobs import JobAnalysis, analyse_jobs
from mrbt_mesh.analysis.tolerance.requirement import TooLargeError
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.build import mission_from_yaml

HEAD = """
mission: m
local_tasks: {look: {sets: [found]}, lift: {parameters: [shelf, kind]}, fetch: {parameters: [what]}}
blackboard: {found: {values: [red, blue]}}
robot_types:
  strong: {capabilities: {look: 1, lift: 1, fetch: 1}}
  weak: {capabilities: {"lift(s1,big)": 1, "lift(s1,small)": 1, fetch: 1}}
robots: {A1: strong, A2: strong, B1: weak, B2: weak}
global_tasks:
  look: {needs: {look: {}}}
  lift: {parameters: [shelf, kind], needs: {"lift($shelf, $kind)": {min: 2}}}
  get: {parameters: [what], needs: {fetch($what): {}}}
  idle: {needs: {look: {min: 2}}}
"""
LIFT = """
ends: never
jobs:
  lift:
    parameters: {shelf: [s1, s2], kind: [small, big]}
    tree: {Sequence: [look, 'lift($shelf, $kind)']}
  fetch:
    attempts: 3
    tree: {Sequence: [{Fallback: [{Condition: found == red}, look]}, get($found)]}
tree: {Parallel: [idle, {Jobs: all}]}
"""


def read(text: str) -> Mission:
    return mission_from_yaml(HEAD + text, "m", Path())


def of_types(mission: Mission) -> dict[str, JobAnalysis]:
    return {each.type: each for each in analyse_jobs(mission, mission.costs, 60)}


def test_each_type_is_analyzed_with_the_arguments_that_survive_least() -> None:
    """On s1 the weak ones can lift as well; on s2 both strong ones have to."""
    found = of_types(read(LIFT))
    lift = found["lift"]
    assert lift.arguments[0] == "s2"
    assert lift.analysis.mission.name == f"m: one job lift(s2, {lift.arguments[1]})"
    assert lift.scarce == ("lift",)
    assert [*map(str, lift.analysis.main.major.critical)] == ["A1", "A2"]
    fetch = found["fetch"]
    assert fetch.analysis.main.is_strong
    assert fetch.scarce == ("look",)
    assert {task.task for task in fetch.analysis.tasks} == {"look", "get($found)"}


@pytest.mark.parametrize(
    ("name", "tree"),
    [
        ("lift", "{Sequence: [look, 'lift(s2, small)']}"),
        (
            "fetch",
            """
  RetryUntilSuccessful:
    attempts: 3
    do: {Sequence: [{Fallback: [{Condition: found == red}, look]}, get($found)]}
""",
        ),
    ],
)
def test_a_job_has_the_figures_of_a_mission_with_its_tree(name: str, tree: str) -> None:
    mission = read(f"tree: {tree}\n")
    wanted = analyse(mission, mission.costs, 60).to_json()
    of_job = of_types(read(LIFT))[name].to_json()
    for key in ("major", "minor", "keeps_every_task", "keeps_parallel_width", "complete"):
        assert of_job[key] == wanted[key], key


def test_too_many_kinds_of_arguments_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "MAX_COMBINATIONS", 3)
    with pytest.raises(TooLargeError, match="jobs of type lift differ in more than 3 ways"):
        of_types(read(LIFT))
