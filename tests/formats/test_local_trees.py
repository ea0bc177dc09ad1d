"""Local tasks that are trees, in mission files: what comes of them, and what is wrong with them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission, mission_from_json
from mrbt_mesh.errors import FileError
from mrbt_mesh.formats.build import mission_from_yaml

# Line numbers below count from the first line of this text, which is line 1.
GOOD = """\
mission: m
parameters: {force: 3, sides: [left, right]}
local_tasks:
  grasp: {parameters: [part], work: 2}
  turn: {parameters: [part, force], work: 3}
  hold:
    parameters: [thing]
    tree:
      Fallback: [{Condition: holding($thing)}, grasp($thing)]
  fasten:
    parameters: [part]
    tree:
      Sequence:
        - SubTree: hold($part)
        - Timeout: {seconds: 2, do: 'turn($part, $force)'}
conditions: {lit: {}}
local_conditions:
  holding: {parameters: [thing], default: true}
robot_types:
  A: {capabilities: {fasten: 1, grasp: 2}}
robots: {A1: A}
global_tasks:
  fix:
    parameters: [side]
    needs: {fasten($side): {}}
tree:
  Sequence:
    for_each: {side: $sides}
    do: fix($side)
"""


def mission(text: str = GOOD) -> Mission:
    return mission_from_yaml(text, "m.yaml", Path("/nowhere"))


def test_there_is_a_ground_tree_for_each_ground_local_task_that_is_needed() -> None:
    trees = mission().local_trees
    assert list(trees) == ["fasten(left)", "fasten(right)"]
    tree = trees["fasten(left)"]
    assert [(node.kind, node.subject or node.name) for node in tree.nodes] == [
        (Kind.SEQUENCE, ""),
        (Kind.SUBTREE, "hold(left)"),
        (Kind.FALLBACK, ""),
        (Kind.CONDITION, "holding(left)"),
        (Kind.ACTION, "grasp(left)"),
        (Kind.TIMEOUT, ""),
        (Kind.ACTION, "turn(left,3)"),
    ]
    assert mission().local_condition_default("holding(left)") is True
    assert not mission().knows_condition("holding(left)")
    assert mission().nominal_work("fasten(left)") == 5_000_000
    assert mission().nominal_work("grasp(left)") == 2_000_000


def test_it_is_compiled_and_part_of_the_digest() -> None:
    trees = mission()
    assert mission_from_compiled(compile_mission(trees), "m.json") == trees
    assert mission(GOOD.replace("seconds: 2", "seconds: 3")).digest != trees.digest
    plain = GOOD[: GOOD.index("    tree:\n      Sequence:\n        - SubTree")]
    plain += GOOD[GOOD.index("conditions: {lit") :]
    assert not mission(plain).local_trees


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("grasp($thing)]", "grap($thing)]", 9, "'grap' is no declared local task; did you mean"),
        ("grasp($thing)]", "grasp]", 9, "local task 'grasp' takes 1 argument (part), found 0"),
        ("grasp($thing)]", "grasp($part)]", 9, "unknown parameter $part"),
        ("grasp($thing)]", "fix(left)]", 9, "'fix' is no declared local task"),
        ("holding($thing)}", "lit}", 9, "'lit' is no declared local condition"),
        ("grasp($thing)]", "holding($thing)]", 9, "write {Condition: holding($thing)}"),
        ("{Condition: holding($thing)}", "hold($thing)", 9, "write {SubTree: hold($thing)}"),
        ("SubTree: hold($part)", "SubTree: grasp($part)", 14, "no declared local task with a tree"),
        ("grasp($thing)]", "{SubTree: fasten($thing)}]", 14, "cycle of subtrees: hold -> fasten"),
        ("Sequence:\n        - S", "Sequnce:\n        - S", 12, "did you mean 'Sequence'?"),
        ("seconds: 2", "seconds: 0", 15, "a number above 0 is expected"),
        ("parameters: [thing]\n", "work: 2\n    parameters: [thing]\n", 6, "a tree or work"),
        ("[thing], default: true", "[thing, thing]", 18, "parameter 'thing' is named twice"),
        ("$force)'}", "a b)'}", 15, "a name with at most 8 arguments"),
        ("force: 3", "force: [1]", 15, "an argument is text or a number, found a list"),
    ],
)
def test_a_mistake_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    assert GOOD.count(old) == 1
    with pytest.raises(FileError) as caught:
        mission(GOOD.replace(old, new))
    (problem,) = (each for each in caught.value.problems if message in each.message)
    assert (problem.file, problem.line) == ("m.yaml", line)
    assert problem.path


def test_a_mistake_in_a_tree_names_the_node() -> None:
    with pytest.raises(FileError) as caught:
        mission(GOOD.replace("grasp($thing)]", "grap($thing)]"))
    (problem,) = caught.value.problems
    assert problem.path == "local_tasks/hold/tree/Fallback[2]"


def test_trees_without_end_are_stopped_at_the_limit_of_nodes() -> None:
    doubling = "".join(
        f"  t{i}: {{tree: {{Sequence: [{{SubTree: t{i + 1}}}, {{SubTree: t{i + 1}}}]}}}}\n"
        for i in range(20)
    )
    text = GOOD.replace("  hold:\n", f"{doubling}  t20: {{tree: grasp(x)}}\n  hold:\n")
    with pytest.raises(FileError, match="more than 20000 nodes once expanded"):
        mission(text.replace("SubTree: hold($part)", "SubTree: t0"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("d['local_trees']['fasten(left)'][-1][0][-1] = []", "SubTree takes exactly one child"),
        ("d['local_trees']['fly(left)'] = d['local_trees']['fasten(left)']", "unknown local task"),
        ("d['local_conditions'] = {}", "'holding(left)'"),
        ("d['local_conditions']['holding'][1] = 3", "condition holding: default"),
        ("del d['local_tasks']['turn']", "'turn(left,3)'"),
    ],
)
def test_a_damaged_compiled_mission_is_refused(change: str, message: str) -> None:
    data = json.loads(compile_mission(mission()))
    exec(change, {"d": data})
    with pytest.raises(FileError) as caught:
        mission_from_compiled(json.dumps(data), "m.json")
    assert message in str(caught.value)


# -- trees in files of BehaviorTree.CPP

XML = '<root BTCPP_format="4"><BehaviorTree ID="Go"><Move to="{to}"/></BehaviorTree></root>'
XML_MISSION = """
mission: trees
parameters: {places: [dock, gate]}
conditions: {there: {parameters: [where]}}
local_tasks:
  go:
    parameters: [where]
    tree: go.xml#Go
    ports: {to: $where, speed: 0.5, all: $places, on: true}
    outputs: {arrived: there($where)}
    work: 3
robot_types: {cart: {capabilities: {go: 1}}}
robots: {A1: cart}
global_tasks: {visit: {parameters: [where], needs: {go($where): {}}}}
tree: {Sequence: {for_each: {where: $places}, do: visit($where)}}
"""


def read_xml(folder: Path, text: str = XML_MISSION, tree: str = XML) -> Mission:
    (folder / "go.xml").write_text(tree)
    return mission_from_yaml(text, "m.yaml", folder)


def test_each_ground_task_has_its_tree_with_its_arguments(tmp_path: Path) -> None:
    trees = read_xml(tmp_path).program_trees
    assert list(trees) == ["go(dock)", "go(gate)"]
    tree = trees["go(gate)"]
    assert (tree.source, tree.tree) == ("go.xml", "Go")
    assert dict(tree.ports) == {"all": "dock;gate", "on": "true", "speed": "0.5", "to": "gate"}
    assert tree.outputs == (("arrived", "there(gate)"),)


def test_what_is_included_is_part_of_the_mission(tmp_path: Path) -> None:
    (tmp_path / "more.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="In"><Stop/></BehaviorTree></root>'
    )
    outer = XML.replace("<BehaviorTree", '<include path="more.xml"/><BehaviorTree')
    mission = read_xml(tmp_path, tree=outer)
    assert "Stop" in mission.program_trees["go(dock)"].xml


def test_programs_compiled_and_read_again_it_is_the_same(tmp_path: Path) -> None:
    mission = read_xml(tmp_path)
    data = json.loads(json.dumps(mission.to_json()))
    assert len(data["program_trees"]["files"]) == 1
    again = mission_from_json(data)
    assert again.program_trees == mission.program_trees
    assert again.digest == mission.digest
    other = read_xml(tmp_path, tree=XML.replace("Move", "Drive"))
    assert other.digest != mission.digest


@pytest.mark.parametrize(
    ("damage", "value"),
    [("files", []), ("trees", {"go(dock)": [0, 1, [], []]}), ("trees", {"go(dock)": [0]})],
)
def test_a_damaged_compiled_program_mission_is_refused(
    tmp_path: Path, damage: str, value: object
) -> None:
    data = json.loads(json.dumps(read_xml(tmp_path).to_json()))
    data["program_trees"][damage] = value
    with pytest.raises(ValueError, match="compiled mission is damaged"):
        mission_from_json(data)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("go.xml#Go", "gone.xml#Go", r"m.yaml:8: local_tasks.go.tree: .*gone.xml.*no such file"),
        ("go.xml#Go", "go.xml#Og", "go.xml: there is no tree 'Og'; known: Go"),
        ("to: $where", "to: $wehre", r"ports.to: unknown parameter \$wehre; did you mean 'where'"),
        ("there($where)}", "their($where)}", "outputs.arrived: 'their' is no declared condition"),
        ("arrived: there($where)", "arrived: there", r"takes 1 argument \(where\), found 0"),
        ("go.xml#Go", "visit", "ports and outputs are those of a tree in a file"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(FileError, match=message):
        read_xml(tmp_path, XML_MISSION.replace(old, new))


def test_a_file_that_is_wrong_is_told_with_its_own_line(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"go.xml:1: .*Sequence"):
        read_xml(tmp_path, tree=XML.replace('<Move to="{to}"/>', "<Sequence/>"))
