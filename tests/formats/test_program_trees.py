"""Local tasks that are trees in BehaviorTree.CPP files: reading, checking, compiling."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrbt_mesh.core.mission.mission import Mission, mission_from_json
from mrbt_mesh.errors import FileError
from mrbt_mesh.formats.build import mission_from_yaml

TREE = '<root BTCPP_format="4"><BehaviorTree ID="Go"><Move to="{to}"/></BehaviorTree></root>'
TEXT = """
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


def read(folder: Path, text: str = TEXT, tree: str = TREE) -> Mission:
    (folder / "go.xml").write_text(tree)
    return mission_from_yaml(text, "m.yaml", folder)


def test_each_ground_task_has_its_tree_with_its_arguments(tmp_path: Path) -> None:
    trees = read(tmp_path).program_trees
    assert list(trees) == ["go(dock)", "go(gate)"]
    tree = trees["go(gate)"]
    assert (tree.source, tree.tree) == ("go.xml", "Go")
    assert dict(tree.ports) == {"all": "dock;gate", "on": "true", "speed": "0.5", "to": "gate"}
    assert tree.outputs == (("arrived", "there(gate)"),)


def test_what_is_included_is_part_of_the_mission(tmp_path: Path) -> None:
    (tmp_path / "more.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="In"><Stop/></BehaviorTree></root>'
    )
    outer = TREE.replace("<BehaviorTree", '<include path="more.xml"/><BehaviorTree')
    mission = read(tmp_path, tree=outer)
    assert "Stop" in mission.program_trees["go(dock)"].xml


def test_compiled_and_read_again_it_is_the_same(tmp_path: Path) -> None:
    mission = read(tmp_path)
    data = json.loads(json.dumps(mission.to_json()))
    assert data["compiled"] == 5
    assert len(data["program_trees"]["files"]) == 1
    again = mission_from_json(data)
    assert again.program_trees == mission.program_trees
    assert again.digest == mission.digest
    other = read(tmp_path, tree=TREE.replace("Move", "Drive"))
    assert other.digest != mission.digest


@pytest.mark.parametrize(
    ("damage", "value"),
    [("files", []), ("trees", {"go(dock)": [0, 1, [], []]}), ("trees", {"go(dock)": [0]})],
)
def test_a_damaged_compiled_mission_is_refused(tmp_path: Path, damage: str, value: object) -> None:
    data = json.loads(json.dumps(read(tmp_path).to_json()))
    data["program_trees"][damage] = value
    with pytest.raises(ValueError, match="compiled mission is damaged"):
        mission_from_json(data)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("go.xml#Go", "gone.xml#Go", r"m.yaml:8: local_tasks.go.tree: .*gone.xml.*no such file"),
        ("go.xml#Go", "go.xml#Og", "go.xml: there is no tree 'Og'; known: Go"),
        ("to: $where", "to: $wehre", r"ports.to: '\$wehre': 'wehre' is not known"),
        ("there($where)}", "their($where)}", "outputs.arrived: condition 'their' is not declared"),
        ("arrived: there($where)", "arrived: there", "takes 1 arguments, not 0"),
        ("go.xml#Go", "visit", "ports and outputs are those of a tree in a file"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(FileError, match=message):
        read(tmp_path, TEXT.replace(old, new))


def test_a_file_that_is_wrong_is_told_with_its_own_line(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"go.xml:1: .*Sequence"):
        read(tmp_path, tree=TREE.replace('<Move to="{to}"/>', "<Sequence/>"))
