"""Local tasks that are trees, in mission files: what comes of them, and what is wrong with them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrbt_mesh.core.mission.mission import Mission, mission_from_json
from mrbt_mesh.errors import FileError
from mrbt_mesh.formats.build import mission_from_yaml

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


def test_compiled_and_read_again_it_is_the_same(tmp_path: Path) -> None:
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
    [
        ("files", []),
        ("files", [["go.xml"]]),
        ("trees", {"go(dock)": [0, 1, [], []]}),
        ("trees", {"go(dock)": [-1, "Go", [], []]}),
        ("trees", {"go(dock)": [0]}),
    ],
)
def test_a_damaged_compiled_mission_is_refused(tmp_path: Path, damage: str, value: object) -> None:
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
        (
            "there($where)}",
            "their($where)}",
            "outputs.arrived: 'their' is not a declared condition",
        ),
        ("arrived: there($where)", "arrived: there", r"takes 1 argument \(where\), found 0"),
        ("    tree: go.xml#Go\n", "", "ports and outputs are those of a tree in a file"),
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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "go.xml#Go",
            "{Sequence: [drive, look]}",
            r"m.yaml:8: local_tasks/go/tree: a robot's tree is not written in YAML: write a "
            r"BehaviorTree.CPP file and name it, e.g. tree: fetch.xml#Fetch$",
        ),
        ("go.xml#Go", "drive", "m.yaml:8: .* a BehaviorTree.CPP file is expected, e.g. fetch.xml"),
        ("go.xml#Go", "[drive]", "m.yaml:8: .* text is expected, found a list"),
        (
            "robots:",
            "local_conditions: {near: {}}\nrobots:",
            "m.yaml:13: .*'local_conditions': a robot's trees read what its program knows .* write "
            "a BehaviorTree.CPP file and name it",
        ),
    ],
)
def test_a_tree_in_yaml_is_refused_with_the_remedy(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(FileError, match=message):
        read_xml(tmp_path, XML_MISSION.replace(old, new))
