"""mrbt tree: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.analysis.team_tree import to_team_tree
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.document import read_document
from mrbt_mesh.core.bt.tree import NodeSpec
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.command import REPAIR, done, mrbt, refused
from tests.support.paths import ROOT

EXAMPLES = sorted(ROOT.glob("examples/*/mission.yaml"))
LIFT = ROOT / "examples" / "lift"

VERSION_3 = """\
<root main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <SequenceStar name="fetch">
      <SubTree ID="Go" target="shelf"/>
      <Grasp object="cup" force="{force}"/>
    </SequenceStar>
  </BehaviorTree>
  <BehaviorTree ID="Go">
    <Action ID="Move" goal="{target}" _onSuccess="moves += 1"/>
  </BehaviorTree>
</root>
"""


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "old.xml"
    path.write_text(VERSION_3)
    return path


def tree(*arguments: str | Path) -> tuple[int, str, str]:
    """(exit status, stdout, stderr) of `mrbt tree`."""
    return mrbt("tree", *map(str, arguments), AMENT_PREFIX_PATH="")


def test_show_the_whole_tree_of_a_robot() -> None:
    code, output, problems = tree("show", REPAIR, "--robot", "C1")
    assert (code, problems) == (0, "")
    lines = output.splitlines()
    assert lines[:10] == [
        "▤ C1  vehicle_repair",
        "└── ⇉ T_i (Parallel 3/3)",
        "    ├── ▣ T_A  task assignment",
        "    │   └── → Sequence",
        "    │       ├── ? Fallback",
        "    │       │   ├── ○ local_task_finished",
        "    │       │   └── ○ new_global_task_executed",
        "    │       ├── ○ check_consistency",
        "    │       └── ▶ assign_agents",
        "    ├── ▣ T_G  global tasks, the same for all robots",
    ]
    assert lines[lines.index("    └── ▣ T_Li  what C1 can do") :] == [
        "    └── ▣ T_Li  what C1 can do",
        "        └── ? Fallback",
        "            ├── ! Inverter",
        "            │   └── ○ assigned",
        "            ├── → Sequence",
        "            │   ├── ○ assigned(move_frame)",
        "            │   └── ▶ move_frame  p = 1",
        "            └── → Sequence",
        "                ├── ○ assigned(use_screwdriver)",
        "                └── ▶ use_screwdriver  p = 1",
    ]


def test_show_the_trees_of_robots_as_json() -> None:
    shown = json.loads(done(tree("show", REPAIR, "--robot", "B1,A1", "--json")))["trees"]
    assert [each["label"] for each in shown] == ["A1", "B1"]
    (whole,) = shown[0]["children"]
    t_a, t_g, t_li = whole["children"]
    assert [part["label"] for part in (t_a, t_g, t_li)] == ["T_A", "T_G", "T_Li"]
    assert t_g["children"] == json.loads(tree("show", REPAIR, "--json")[1])["trees"][0]["children"]
    branches = [each["children"][1] for each in t_li["children"][0]["children"][1:]]
    assert [(leaf["type"], leaf["label"], leaf["notes"]) for leaf in branches] == [
        ("action", "do_diagnosis", ["p = 3"]),
        ("action", "replace_hw", ["p = 1.5"]),
        ("action", "replace_wires", ["p = 1.5"]),
    ]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ((REPAIR, "--robot", "Z9"), "--robot Z9: mission vehicle_repair has no robot 'Z9'"),
        ((REPAIR, "--robot", "A1", "--only", "x"), "give --robot or --only"),
        ((REPAIR, "--json", "--mermaid"), "--mermaid and --json: give one of them"),
        ((LIFT / "robot.xml", "--robot", "A1"), "--robot is for mission files"),
    ],
)
def test_show_refuses_what_does_not_fit(arguments: tuple[Any, ...], problem: str) -> None:
    assert problem in refused(tree("show", *arguments))


def test_show_as_text(old: Path) -> None:
    code, output, problems = tree("show", old)
    assert (code, problems) == (0, "")
    assert output.splitlines() == [
        "▤ Main  main tree",
        "└── →* fetch (SequenceWithMemory)",
        "    ├── ▣ Go  target = {shelf}",
        "    └── ▶ Grasp  object = cup, force = {force}",
        "",
        "▤ Go",
        "└── ▶ Move  goal = {target}, _onSuccess: moves += 1",
    ]


def test_show_only_one_tree(old: Path) -> None:
    assert tree("show", old, "--only", "Go")[1].startswith("▤ Go")
    problems = refused(tree("show", old, "--only", "Gone"))
    assert "there is no tree 'Gone'; known: Main, Go" in problems


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_show_a_mission(path: Path) -> None:
    mission = load_mission(path)
    output = done(tree("show", path))
    assert len(output.splitlines()) == len(mission.tree.nodes) + 1
    for node in mission.tree.nodes:
        assert node.label in output


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_a_flowchart(path: Path) -> None:
    nodes = len(load_mission(path).tree.nodes) + 1
    mermaid = tree("show", path, "--mermaid")[1]
    assert mermaid.count(" --- ") == nodes - 1


def test_show_draws_a_file_with_errors(tmp_path: Path) -> None:
    path = tmp_path / "bad.xml"
    path.write_text('<root BTCPP_format="4"><BehaviorTree ID="A"><Sequence/></BehaviorTree></root>')
    code, output, problems = tree("show", path)
    assert code == 0
    assert "Sequence" in output
    assert f"an error in {path}: mrbt tree check lists all" in problems


def test_brackets_in_a_files_name_are_printed(tmp_path: Path) -> None:
    path = tmp_path / "[bold]x[red].xml"
    path.write_text('<root BTCPP_format="4"><BehaviorTree ID="A"><Sequence/></BehaviorTree></root>')
    assert f"error: {path}:1: A/Sequence: " in tree("check", path)[2]
    assert f"an error in {path}: " in tree("show", path)[2]
    path.write_text('<root BTCPP_format="4"><BehaviorTree ID="A"><X/></BehaviorTree></root>')
    assert f"valid {path}: 1 file, 1 tree, 1 node" in tree("check", path)[1]
    assert f"written {path}: 1 tree" in tree("convert", path, path)[1]


def test_convert_version_3(old: Path, tmp_path: Path) -> None:
    target = tmp_path / "new.xml"
    code, output, problems = tree("convert", old, target)
    assert code == 0
    assert "2 trees" in output
    assert f"{old}:3: SequenceStar fetch: version 3: <SequenceStar> is" in problems
    assert f"{old}:4: SubTree Go: version 3: target='shelf' names a blackboard entry" in problems
    assert tree("check", target, "--strict")[0] == 0
    names = {element.tag for element in read_document(target).root.walk()}
    assert names >= {"Control", "Action", "SubTree", "TreeNodesModel", "input_port", "inout_port"}
    short = tmp_path / "short.xml"
    assert tree("convert", target, short, "--compact")[0] == 0
    assert "<SequenceWithMemory " in short.read_text()
    again = tmp_path / "again.xml"
    assert tree("convert", short, again)[0] == 0
    assert tree("convert", target, tmp_path / "same.xml")[0] == 0
    assert (tmp_path / "same.xml").read_text() == target.read_text()


def test_convert_with_ids(old: Path, tmp_path: Path) -> None:
    target = tmp_path / "ids.xml"
    assert tree("convert", old, target, "--ids")[0] == 0
    document = read_document(target)
    assert [t.get("_fullpath") for t in document.trees] == ["", "Go::2"]
    # As BehaviorTree.CPP counts: what stands in a SubTree comes right after it.
    assert [e.get("_uid") for e in document.root.walk() if e.get("_uid")] == ["1", "2", "4", "3"]


def test_convert_merges_included_files(tmp_path: Path) -> None:
    corpus = ROOT / "tests" / "btcpp" / "files" / "corpus"
    target = tmp_path / "merged.xml"
    assert tree("convert", corpus / "include.xml", target, "--merge")[0] == 0
    document = read_document(target)
    assert {t.get("ID") for t in document.trees} == {"Main", "First", "Second"}
    assert not document.includes
    assert len(document.model_lists) == 1
    assert tree("check", target, "--strict")[0] == 0


def _bare(spec: NodeSpec) -> NodeSpec:
    children = tuple(map(_bare, spec.children))
    return replace(spec, children=children)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_convert_a_mission_and_take_it_back(path: Path, tmp_path: Path) -> None:
    target = tmp_path / "mission.xml"
    if load_mission(path).jobs:
        code, _, problems = tree("convert", path, target)
        assert (code, target.exists()) == (2, False)
        assert "BehaviorTree.CPP has no node for jobs" in problems
        return
    assert tree("convert", path, target)[0] == 0
    library, findings = check_file(target, is_strict=True)
    assert not findings.in_order()
    result = to_team_tree(library, "MainTree")
    assert result.spec == _bare(load_mission(path).tree.spec())
    code, output, problems = tree("check", target, "--team", "--strict")
    assert code == 0
    assert all(line.startswith("note: ") for line in problems.splitlines()), problems
    assert output.startswith("valid")


def test_check_json(old: Path) -> None:
    code, output, problems = tree("check", old, "--json", "--team")
    assert (code, problems) == (2, "")
    data = json.loads(output)
    assert (data["valid"], data["files"], data["trees"], data["nodes"]) == (False, 1, 2, 4)
    assert {f["severity"] for f in data["findings"]} == {"warning"}
    assert [f["line"] for f in data["findings"]] == [1, 3, 4]
    refused = [(r["line"], r["path"]) for r in data["refusals"]]
    assert [place for place in refused if place != (3, "Main/fetch")] == [
        (5, "Main/fetch/Grasp"),
        (9, "Main/fetch/Go/Move"),
        (9, "Main/fetch/Go/Move"),
    ]


def test_check_json_of_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "bad.xml"
    path.write_text("<root>\n<a>\n</root>")
    code, output, problems = tree("check", path, "--json")
    assert (code, problems) == (2, "")
    data = json.loads(output)
    assert data["valid"] is False
    assert [f["line"] for f in data["findings"]] == [3]


def test_check_for_a_team(old: Path) -> None:
    problems = refused(tree("check", old, "--team", "--assume-actions"))
    reason = "Grasp: port 'force' uses the blackboard entry 'force', which a team does not share"
    assert f"not for a team: {old}:5: Main/fetch/Grasp: {reason}" in problems


def test_check_for_a_team_notes_what_a_team_does_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "reactive.xml"
    path.write_text(
        '<root BTCPP_format="4">\n<BehaviorTree ID="A">\n<ReactiveSequence>\n'
        "<Move/>\n<Grasp/>\n</ReactiveSequence>\n</BehaviorTree>\n"
        '<TreeNodesModel><Action ID="Move"/><Action ID="Grasp"/></TreeNodesModel></root>'
    )
    code, output, problems = tree("check", path, "--team")
    assert code == 0
    assert output.startswith("valid")
    said = "ReactiveSequence: an action before its last child is begun again at every tick"
    assert problems.startswith(f"note: {path}:3: A/ReactiveSequence: {said}")
    data = json.loads(tree("check", path, "--team", "--json")[1])
    assert (data["valid"], data["refusals"]) == (True, [])
    (note,) = data["notes"]
    assert (note["file"], note["line"], note["path"]) == (str(path), 3, "A/ReactiveSequence")
    assert note["reason"].startswith(said)
    assert tree("check", path)[2] == ""


@pytest.mark.parametrize(
    "command",
    [
        ["tree", "check", "--strict"],
        ["tree", "lift", "--tree", "Repair"],
    ],
)
def test_packages_are_sought_where_ros_2_has_them(tmp_path: Path, command: list[Any]) -> None:
    package = tmp_path / "ros" / "share" / "garage"
    package.mkdir(parents=True)
    (package / "repair.xml").write_text((LIFT / "repair.xml").read_text())
    path = tmp_path / "tree.xml"
    path.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="Mine">'
        '<include ros_pkg="garage" path="repair.xml"/>'
        '<BehaviorTree ID="Mine"><SubTree ID="Repair"/></BehaviorTree></root>'
    )
    arguments = [*map(str, command), str(path)]
    prefixes = os.pathsep.join([str(tmp_path / "none"), "", str(tmp_path / "ros")])
    done(mrbt(*arguments, AMENT_PREFIX_PATH=prefixes))
    assert mrbt(*arguments, AMENT_PREFIX_PATH="")[0] == 2


def test_check_a_mission() -> None:
    assert "a mission, " in done(tree("check", REPAIR))
    data = json.loads(tree("check", REPAIR, "--json")[1])
    assert data["valid"] is True


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "none.xml"], "none.xml: there is no such file"),
        (["show", "none.yaml"], "none.yaml: there is no such file"),
        (["show", "tree.txt"], "a tree is in a file that ends in .xml"),
        (["convert", REPAIR, "out.yaml"], "the file to write has to end in .xml"),
        (["convert", REPAIR, "out.xml", "--ids"], "--ids and --merge are for BehaviorTree.CPP"),
        (["convert", "a.xml", "b.xml", "--ids", "--merge"], "--ids goes without"),
        (["check", REPAIR, "--assume-actions"], "--assume-actions: goes with --team"),
    ],
)
def test_bad_input(arguments: list[str], message: str) -> None:
    assert message in refused(tree(*arguments))


LEAVES = """
from mrbt_mesh.btcpp import Leaves

leaves = Leaves()


@leaves.condition("Near")
def near(goal: str) -> bool:
    return goal == "dock"
"""


def test_run_says_what_is_odd_about_the_file(tmp_path: Path) -> None:
    file, program = tmp_path / "near.xml", tmp_path / "robot.py"
    tree = '<include path="nowhere.xml"/><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree>'
    file.write_text(f'<root BTCPP_format="4">{tree}</root>')
    program.write_text(LEAVES)
    code, output, problems = mrbt("tree", "run", str(file), "--program", str(program))
    assert (code, output) == (0, "SUCCESS\n")
    assert problems.startswith(f"warning: {file}:1: root/include: there is no file ")


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--set", "goal=dock"], 0, "SUCCESS"),
        (["--set", "goal=gate"], 1, "FAILURE"),
        (["--set", "goal"], 2, "--set goal: NAME=TEXT is expected"),
        ([], 2, "goal"),
        (["--tree", "Mian"], 2, "Mian"),
    ],
)
def test_run(tmp_path: Path, options: list[str], code: int, said: str) -> None:
    file, program = tmp_path / "near.xml", tmp_path / "robot.py"
    tree = '<BehaviorTree ID="Main"><Near goal="{goal}"/></BehaviorTree>'
    file.write_text(f'<root BTCPP_format="4">{tree}</root>')
    program.write_text(LEAVES)
    found = mrbt("tree", "run", str(file), "--program", str(program), *options)
    assert found[0] == code
    assert said in found[1] + found[2]
