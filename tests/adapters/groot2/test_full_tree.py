"""Trees as BehaviorTree.CPP tells them to a monitor."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.adapters.groot2 import full_tree
from mrbt_mesh.adapters.groot2.full_tree import FullTree
from mrbt_mesh.adapters.node_statuses import observed_tree
from mrbt_mesh.btcpp.files.document import parse_document, type_id
from mrbt_mesh.core.bt.tree import Kind, build_tree
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.build import action, condition, fallback, sequence
from tests.support.paths import EXAMPLES, mission_file

MISSIONS = sorted(EXAMPLES.glob("*/mission.yaml"))


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.parent.name)
@pytest.mark.parametrize("is_robot", [False, True], ids=["team", "robot"])
def test_every_node_has_the_uid_of_its_index(path: Path, is_robot: bool) -> None:
    mission = load_mission(path)
    tree = observed_tree(mission, next(iter(mission.robots)) if is_robot else None).tree
    document = parse_document(FullTree(tree, mission.name).xml, "full tree")
    elements = {int(e.get("_uid")): e for e in document.root.walk() if e.get("_uid")}
    assert sorted(elements) == [node.index + 1 for node in tree.nodes]
    described = {element.get("ID") for element in document.model_lists[0].children}
    for node in tree.nodes:
        element = elements[node.index + 1]
        if node.kind is Kind.SUBTREE:
            assert element.tag == "SubTree"
        else:
            assert type_id(element) in described
        if node.kind in (Kind.ACTION, Kind.CONDITION):
            assert element.get("name") == (node.name or node.subject)


def test_paths_and_blackboards_of_subtrees() -> None:
    mission = load_mission(mission_file("vehicle_repair"))
    found = FullTree(mission.tree, "T_G")
    document = parse_document(found.xml, "full tree")
    paths = [tree.get("_fullpath") for tree in document.trees]
    assert paths[0] == ""
    assert len(set(paths)) == len(paths) == 6
    assert list(found.blackboards) == ["MainTree", *paths[1:]]
    assert found.blackboards["MainTree"][0] == "nominal"
    assert found.blackboards[paths[1]] == ("broken(1)",)
    used = {e.get("_fullpath") for e in document.root.walk() if e.tag == "SubTree"}
    assert used == {*paths[1:]}


def test_a_tree_of_more_nodes_than_uids_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(full_tree, "MAX_UID", 3)
    tree = build_tree(sequence(fallback(condition("a"), action("b")), action("c")))
    with pytest.raises(InputError, match="big: 5 nodes, Groot2's protocol has 3"):
        FullTree(tree, "big")
