"""Missions: names, performances, the digest that every robot of a team must share."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from mrbt_mesh.core.bt.tree import Kind, NodeSpec, build_tree
from mrbt_mesh.core.mission.mission import Mission, mission_from_json, performance
from mrbt_mesh.core.mission.names import is_robot_id, split_call, type_name
from tests.support.build import action, condition, make_mission, retry, sequence, task, timeout


def mission() -> Mission:
    tree = sequence(
        condition("open"),
        retry(3, timeout(2, action("fix"))),
        NodeSpec(Kind.SUBTREE, (action("a"),)),
    )
    fix = task("fix", ("weld(2)", 1, 2), ("look", 1, 1), blocked_fail_after_us=5, preemptive=True)
    return make_mission(tree, {"B1": {"weld": 0.5}, "A1": {"look": 2}}, [fix], ["open"])


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("fix", ("fix", ())),
        ("fix(2)", ("fix", ("2",))),
        ("move_to(1.5,-2,shelf_A)", ("move_to", ("1.5", "-2", "shelf_A"))),
    ],
)
def test_ground_names_are_split_into_type_and_arguments(
    text: str, parts: tuple[str, tuple[str, ...]]
) -> None:
    assert split_call(text) == parts
    assert type_name(text) == parts[0]


@pytest.mark.parametrize("text", ["", "2fix", "fix()", "fix(a", "fix(a b)", "fix($)", "a/b", "é"])
def test_what_is_no_ground_name_is_told(text: str) -> None:
    with pytest.raises(ValueError, match="is not a name like fix_hw or fix_hw"):
        split_call(text)


def test_a_name_has_at_most_eight_arguments() -> None:
    assert len(split_call("f(" + ",".join("12345678") + ")")[1]) == 8
    with pytest.raises(ValueError, match="more than 8 arguments"):
        split_call("f(" + ",".join("123456789") + ")")


@pytest.mark.parametrize(
    ("text", "good"),
    [
        ("A1", True),
        ("a-b_C", True),
        ("x" * 32, True),
        ("x" * 33, False),
        ("", False),
        ("-a", False),
    ],
)
def test_robot_ids(text: str, good: bool) -> None:
    assert is_robot_id(text) is good


def test_a_capability_for_the_ground_task_goes_before_one_for_its_type() -> None:
    can = {"fix": 5, "fix(2)": 9}
    assert [performance(can, name) for name in ("fix(1)", "fix(2)", "fly")] == [5, 9, None]


def test_conditions_are_known_by_name_and_number_of_arguments() -> None:
    one = mission()
    names = ("open", "open(1)", "shut", "op en")
    assert [name for name in names if one.entries.is_condition(name)] == ["open"]
    assert one.entries.default("open") is True
    assert one.entries.default("unheard_of") is False


def test_a_mission_survives_being_compiled() -> None:
    one = mission()
    other = mission_from_json(json.loads(json.dumps(one.to_json())))
    assert other.digest == one.digest
    assert other.tree == one.tree
    assert other.global_tasks == one.global_tasks
    assert list(other.robots) == ["A1", "B1"]


def test_the_digest_changes_with_everything_that_robots_must_agree_on() -> None:
    one = mission()
    tasks = {**one.global_tasks, "fix": replace(one.global_tasks["fix"], preemptive=False)}
    others = [
        replace(one, name="other"),
        replace(one, robots={"A1": one.robots["A1"]}),
        replace(one, global_tasks=tasks),
        replace(one, tree=build_tree(action("fix"))),
        replace(one, conditions={}),
        replace(one, parameters={"speed": 2}),
    ]
    assert len({each.digest for each in [one, *others]}) == len(others) + 1


def test_the_robots_program_and_the_order_of_declarations_do_not_change_the_digest() -> None:
    one = mission()
    assert replace(one, program="mine.py").digest == one.digest
    assert replace(one, robots=dict(reversed(one.robots.items()))).digest == one.digest


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"compiled": 99}, "compiled mission version 4 expected, found 99"),
        ({"tree": ["Sequence"]}, "tree: an object expected"),
        ({"robots": 3}, "compiled mission is damaged: robots: an object expected, not 3"),
        ({"assignment": "spare_scarce"}, "damaged: assignment: nothing of this name"),
        ({"tree": {"kind": "Dance"}}, "tree.kind: .* expected, not 'Dance'"),
    ],
)
def test_a_damaged_compiled_mission_is_a_value_error(
    change: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        mission_from_json({**mission().to_json(), **change})
