"""What drill files may say, and what is said of those that are wrong: message and line."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.drills.drill_file import drill_files, drill_folder, load_drills
from mrbt_mesh.drills.model import RoleModel, StepModel
from mrbt_mesh.errors import FileError, Problem
from tests.support.paths import ROOT, mission_file

# Line numbers below count from the first line of this text, which is line 1.
GOOD = """\
name: good
description: $nothing is replaced here
mission: MISSION
for_each:
  robot: [A1, B1]
  part: [2, 4]
speed: 4
timing: {beat_s: 0.1, detection_s: 0.5}
transport: [wired, wireless]
network: namespaces
steps:
  - at: 0.5
    stop: [A1, A2]
  - at: 1
    continue: {stopped}
  - when: {global_task: fix_hw($part), status: running}
    after: 0.2
    kill: {performing: fix_hw($part)}
  - when: {local_task: replace_hw($part), robot: $robot, phase: done}
    lose: {permille: 300, from: $robot, to: {replacement}}
  - when: {robot: $robot, state: dead}
    restart: $robot
  - when: {condition: broken(2), is: true}
    lose_capability: {robots: B2, local_task: replace_hw}
    decide: {global_task: fix_hw(2), decision: retry}
  - cycles: 2
    steps:
      - after: 0.1
        partition: [[A1, B1], [A2]]
      - after: 0.2
        heal: true
expect:
  result: success
  dead: {killed}
  done:
    - {local_task: replace_hw($part), times: 1}
  never:
    - {local_task: do_diagnosis}
"""


def written(folder: Path, text: str) -> Path:
    mission = mission_file("vehicle_repair")
    path = folder / "drill.yaml"
    path.write_text(text.replace("MISSION", str(mission)))
    return path


def problems_of(folder: Path, text: str) -> list[Problem]:
    with pytest.raises(FileError) as caught:
        load_drills(written(folder, text))
    return caught.value.problems


def test_a_drill_per_combination_with_its_values_in_place(tmp_path: Path) -> None:
    drills = load_drills(written(tmp_path, GOOD))
    assert [drill.label for drill in drills] == [
        "good[robot=A1,part=2]",
        "good[robot=A1,part=4]",
        "good[robot=B1,part=2]",
        "good[robot=B1,part=4]",
    ]
    last = drills[-1]
    kill = last.steps[2].kill
    assert isinstance(kill, RoleModel)
    assert (kill.role, kill.performing) == ("performing", "fix_hw(4)")
    assert last.steps[4].restart == "B1"
    assert last.model.expect.done[0].local_task == "replace_hw(4)"
    assert last.model.profiles == ["wired", "wireless"]
    assert last.robots == ("A1", "A2", "B1", "B2", "C1", "C2")


def test_cycles_are_written_out(tmp_path: Path) -> None:
    steps = load_drills(written(tmp_path, GOOD))[0].steps
    assert [name for step in steps[6:] for name, _ in step.faults()] == ["partition", "heal"] * 2
    assert all(isinstance(step, StepModel) for step in steps)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("name: good", "nam: good", 1, "unknown key 'nam'; did you mean 'name'?"),
        ("name: good", "name: a b", 1, "the name of a drill is expected"),
        ("mission: MISSION", "mission: none.yaml", 3, "there is no such file"),
        ("speed: 4", "speed: fast", 7, "a number is expected, found the text 'fast'"),
        ("speed: 4", "robots: [A1, D9]", 7, "no robot 'D9' in this mission"),
        ("beat_s: 0.1", "beat_s: 0.4", 8, "must be at least 3 beat periods"),
        ("[wired, wireless]", "radio", 9, "wired or wireless is expected"),
        ("part: [2, 4]", "part: 2", 6, "a list of values is expected, found the number 2"),
        ("part: [2, 4]", "part: []", 6, "a list of values is expected"),
        ("  part: [2, 4]\n", "", 15, "no $part in for_each; known: robot"),
        ("  - at: 1\n", "  - at: 0.1\n", 14, "the step before is at 0.5 already"),
        ("  - at: 1\n", "  - at: 1\n    after: 2\n", 14, "a step needs at, or when"),
        ("    continue: {stopped}\n", "", 14, "a step needs at least one of kill, stop, continue"),
        ("{stopped}", "{stoped}", 15, "a role has exactly one of the keys performing"),
        ("stop: [A1, A2]", "stop: [A1, A7]", 13, "no robot 'A7' in this mission; known: A1, A2"),
        ("stop: [A1, A2]", "stop: 3", 13, "a robot, a list of robots, or a role"),
        ("{global_task: fix_hw($part)", "{global_task: fix($part)", 16, "no global task 'fix(2)'"),
        ("status: running", "status: runs", 16, "one of idle, running, success, failure"),
        ("{performing: fix_hw($part)}", "{performing: weld}", 18, "no task 'weld' in this mission"),
        ("phase: done", "phase: ended", 19, "one of claimed"),
        ("{local_task: replace_hw($part), robot", "{robot", 19, "unknown key 'phase'"),
        ("{robot: $robot, state: dead}", "{state: dead}", 21, "a trigger with one of global_task"),
        ("condition: broken(2)", "condition: borken(2)", 23, "no condition 'borken(2)'"),
        ("decision: retry", "decision: again", 25, "one of done, failed, retry is expected"),
        ("decide: {global_task: fix_hw(2)", "decide: {global_task: fix", 25, "no global task"),
        ("permille: 300", "permille: 1001", 20, "a number of at most 1000 is expected"),
        ("network: namespaces\n", "", 19, "lose needs `network: namespaces`"),
        ("      - after: 0.1", "      - at: 0.1", 28, "a step that is repeated has no `at`"),
        (
            "restart: $robot",
            "kill_router: 1",
            22,
            "no router 1: the drill's `routers` is 0",
        ),
        ("restart: $robot", "stop_router: A", 22, "a whole number is expected"),
        ("speed: 4", "routers: 2", 7, "routers need `network: loopback`, `transport: wired`"),
        ("heal: true", "heal: false", 31, "true is expected, found false"),
        ("restart: $robot", "join: $robot", 22, "A1 is in the team from the start"),
        ("restart: $robot", "join: {killed}", 22, "a robot, or a list of robots, is expected"),
        ("times: 1", "times: 1, at_most: 2", 36, "times, or at_least and at_most, or one of them"),
        ("do_diagnosis}", "do_it}", 38, "no local task 'do_it' in this mission"),
        ("speed: 4", "beside: python world.py", 7, "a list is expected"),
        ("speed: 4", "beside: [python 'world.py]", 7, "a command, e.g. python world.py is"),
        ("result: success", "checks: ['']", 33, "a command, e.g. python world.py is expected"),
        ("result: success", "result: good", 33, "success, failure or blocked is expected"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(
    tmp_path: Path, old: str, new: str, line: int, message: str
) -> None:
    assert GOOD.count(old) >= 1
    problems = problems_of(tmp_path, GOOD.replace(old, new, 1))
    assert any(p.line == line and message in p.message for p in problems), problems


def test_a_mission_that_is_wrong_is_named_itself(tmp_path: Path) -> None:
    (tmp_path / "mission.yaml").write_text("mission: m\n")
    path = tmp_path / "drill.yaml"
    path.write_text("name: d\nmission: mission.yaml\n")
    with pytest.raises(FileError, match=r"mission.yaml:1: the key 'local_tasks' is missing"):
        load_drills(path)


def test_files_that_are_no_drills(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="there is no such file"):
        load_drills(tmp_path / "none.yaml")
    path = tmp_path / "list.yaml"
    path.write_text("- a\n")
    with pytest.raises(FileError, match="a drill is expected"):
        load_drills(path)
    path.write_text("for_each: {a: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]}\nname: d\n")
    with pytest.raises(FileError, match="'mission' is missing"):
        load_drills(path)
    with pytest.raises(FileError, match="the folder has no drill"):
        drill_files(tmp_path / "nowhere")


def test_too_many_combinations_are_refused(tmp_path: Path) -> None:
    ten = "[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]"
    text = f"name: d\nmission: MISSION\nfor_each: {{a: {ten}, b: {ten}, c: {ten}, d: [1, 2]}}\n"
    (problem,) = problems_of(tmp_path, text)
    assert (problem.line, problem.message) == (3, "2000 combinations; at most 1000 are run")


def test_the_shipped_drills_are_all_good_and_bear_the_names_of_their_files() -> None:
    files = drill_files(ROOT / "drills")
    assert len(files) >= 14
    for path in files:
        for drill in load_drills(path):
            assert drill.model.name == path.stem
            assert drill.model.description


def test_the_folder_is_found_here_or_beside_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert drill_folder() == ROOT / "drills"
    written(tmp_path, GOOD)
    (tmp_path / "drills").mkdir()
    assert drill_folder() == ROOT / "drills"
    written(tmp_path / "drills", GOOD)
    assert drill_folder() == tmp_path / "drills"
