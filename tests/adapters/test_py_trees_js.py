"""Snapshots for py_trees_js."""

from __future__ import annotations

import json
import runpy
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.adapters.py_trees_js import export, snapshot
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.run import simulate
from tests.support.groot2 import Desk
from tests.support.paths import mission_file

STATUSES = {"INVALID", "FAILURE", "RUNNING", "SUCCESS"}


def check(found: dict[str, Any]) -> None:
    """What a snapshot has to be by the README of py_trees_js, *The JSON Specification*."""
    assert json.loads(json.dumps(found)) == found
    behaviours = found["behaviours"]
    for name, behaviour in behaviours.items():
        assert behaviour["id"] == name
        assert behaviour["status"] in STATUSES
        assert isinstance(behaviour["name"], str)
        assert len(behaviour["colour"]) == 7
        assert behaviour["colour"][0] == "#"
        assert isinstance(behaviour.get("data", {}), dict)
    children = [child for each in behaviours.values() for child in each.get("children", ())]
    # One tree: everybody is the child of one other, but for the root.
    assert sorted([*children, "1"]) == sorted(behaviours)
    assert set(found["visited_path"]) <= behaviours.keys()
    board = found.get("blackboard", {"behaviours": {}, "data": {}})
    for name, keys in board["behaviours"].items():
        assert name in behaviours
        assert set(keys.values()) <= {"r", "w", "x"}
        if board["data"]:
            assert keys.keys() <= board["data"].keys()


def test_a_team_at_work() -> None:
    desk = Desk()
    desk.go("pass 300")
    header, line = export.start(desk.observer.mission, 1_000_000, 0)
    found = json.loads(header + line(desk.observer, 2_500_000))
    check(found)
    assert found["timestamp"] == 1.5
    assert found["visited_path"] == ["1", "2", "3", "4"]
    weld = found["behaviours"]["4"]
    assert (weld["name"], weld["status"], weld["data"]["Feedback"]) == ("weld", "RUNNING", "A")
    assert found["blackboard"] == {
        "behaviours": {"3": {"/done": "r"}},
        "data": {"/done": "False"},
    }


def test_only_what_has_changed_is_told_again() -> None:
    desk = Desk()
    desk.go("pass 300")
    _, line = export.start(desk.observer.mission, 0, 0)
    assert line(desk.observer, 1).endswith(b"\n")
    desk.go("pass 300")
    assert line(desk.observer, 2) == b""
    desk.go("set A done=true", "pass 300")
    assert json.loads(line(desk.observer, 3))["blackboard"]["data"] == {"/done": "True"}


@pytest.mark.parametrize("example", ["vehicle_repair", "explore", "couriers"])
@pytest.mark.parametrize("is_robot", [False, True])
def test_every_snapshot_of_a_run_is_one(example: str, is_robot: bool) -> None:
    mission = load_mission(mission_file(example))
    assert mission.program is not None
    robot = next(iter(mission.robots)) if is_robot else None
    tree = ObservedTree(mission, robot)
    found: list[dict[str, Any]] = []
    result = simulate(
        mission,
        load_program(mission.program),
        seed=1,
        speed=20,
        inspect=False,
        look_on=lambda observer, now_us: found.append(snapshot(tree, observer)),
    )
    assert result.result == "success"
    for each in found[:: max(1, len(found) // 50)]:
        check(each)
    assert found[-1]["behaviours"]["1"]["status"] == "SUCCESS"


def test_its_own_example_passes_the_same_check() -> None:
    package = find_spec("py_trees_js")
    if package is None or package.origin is None:
        pytest.skip("py_trees_js is not installed: make test-interop")
    # By its file: the package itself cannot be imported without Qt.
    path = Path(package.origin).parent / "viewer" / "trees.py"
    trees: dict[str, Any] = runpy.run_path(str(path))
    example = trees["create_demo_tree_definition"]()
    check(example)
    desk = Desk()
    desk.go("pass 300")
    mine = {"timestamp": 0, **snapshot(ObservedTree(desk.observer.mission), desk.observer)}
    assert mine.keys() <= example.keys()
    keys = {key for each in example["behaviours"].values() for key in each}
    assert {key for each in mine["behaviours"].values() for key in each} <= keys
    assert mine["blackboard"].keys() == example["blackboard"].keys()
