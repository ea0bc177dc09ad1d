"""What a page is told of a mission once."""

from __future__ import annotations

import json

from mrbt_mesh.views.model.mission_view import mission_view
from tests.support.runs import example


def test_the_tree_by_index_with_parents() -> None:
    mission, _ = example("vehicle_repair")
    told = mission_view(mission)
    assert len(told["tree"]) == len(mission.tree.nodes)
    for index, row in enumerate(told["tree"]):
        for child in mission.tree.nodes[index].children:
            assert told["tree"][child]["parent"] == index
        assert row["label"] == mission.tree.nodes[index].label
    assert told["tree"][0]["parent"] == -1


def test_robots_and_tasks_in_units() -> None:
    mission, _ = example("vehicle_repair")
    told = mission_view(mission)
    assert told["robots"]["A1"] == {
        "type": "A",
        "capabilities": {"do_diagnosis": 3.0, "replace_hw": 1.5, "replace_wires": 1.5},
    }
    (need,) = told["tasks"]["remove_cover"]["needs"]
    assert (need["local_task"], need["min"], need["max"]) == ("move_frame", 2, 2)
    (node,) = told["tasks"]["remove_cover"]["nodes"]
    assert told["tree"][node]["subject"] == "remove_cover"


def test_a_command_that_submits_a_job() -> None:
    assert mission_view(example("vehicle_repair")[0])["submit"] is None
    told = mission_view(example("deliveries")[0])
    assert told["submit"] == "mrbt submit deliver shelf_1 dock_1 1"


def test_all_examples_are_plain_data() -> None:
    for name in ("vehicle_repair", "couriers", "depot", "dispense", "explore", "assembly"):
        told = mission_view(example(name)[0])
        assert json.loads(json.dumps(told)) == told
