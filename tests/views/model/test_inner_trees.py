"""Trees of local tasks as views draw them."""

from __future__ import annotations

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.views.model.inner_trees import program_tree, trees_by_type, with_inner_trees
from mrbt_mesh.views.model.mission_view import tree_view
from mrbt_mesh.views.model.own_trees import OwnTrees
from tests.support.paths import EXAMPLES

MISSION = load_mission(EXAMPLES / "inspection" / "mission.yaml")


def test_the_tree_stands_below_its_local_task() -> None:
    local = OwnTrees("R1", MISSION.robots["R1"].capabilities).local
    before = tree_view(local)
    rows, statuses = with_inner_trees(before, range(len(before)), MISSION)
    assert len(rows) == len(statuses) == len(before) + 9
    assert [row["parent"] < index for index, row in enumerate(rows)] == [True] * len(rows)
    (inspect,) = (index for index, row in enumerate(rows) if row["label"] == "inspect")
    assert rows[inspect + 1]["parent"] == inspect
    below = [row["label"] for row in rows[inspect + 1 :]]
    assert below == [
        "Sequence",
        "Drive",
        "drive or back up (RecoveryNode) number_of_retries=2",
        "Timeout msec=5000",
        "DriveTo(goal={valve}, tries={tries})",
        "BackUp(distance_m=0.3)",
        "RetryUntilSuccessful num_attempts=3",
        "ReadGauge(valve={valve}, pressure_bar={bar})",
        "Script(code=too_high := bar > limit_bar)",
    ]
    assert statuses[inspect] == inspect
    assert set(statuses[inspect + 1 :]) == {0}
    parents = {row["label"]: rows[row["parent"]]["label"] for row in rows[inspect + 2 :]}
    assert parents["BackUp(distance_m=0.3)"].startswith("drive or back up")
    assert parents["Script(code=too_high := bar > limit_bar)"] == "Sequence"


def test_one_tree_for_each_type_of_local_task() -> None:
    programs = trees_by_type(MISSION)
    assert list(programs) == ["inspect"]
    assert program_tree(programs["inspect"]).type == "Sequence"


def test_without_such_trees_nothing_changes() -> None:
    mission = load_mission(EXAMPLES / "explore" / "mission.yaml")
    rows = tree_view(OwnTrees("R1", mission.robots["R1"].capabilities).local)
    assert with_inner_trees(rows, [0] * len(rows), mission)[0] == rows
