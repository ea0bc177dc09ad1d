"""Parameters, for-each and subtrees, down to ground trees."""

import json
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import CONTROLS, Kind, NodeSpec
from mrbt_mesh.core.mission.compiled import mission_from_compiled
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.names import split_call
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.expand import argument_text, call_text, split_template, to_micro
from mrbt_mesh.formats.mission_file import FileError, compile_mission

HEAD = {
    "mission": "m",
    "parameters": {"parts": [1, 2], "colours": ["red", "blue"], "last": 9, "on": True, "of": 0.5},
    "local_tasks": {"weld": {"parameters": ["part"]}, "paint": {"parameters": ["part", "colour"]}},
    "conditions": {"broken": {"parameters": ["part"]}, "nominal": {}},
    "robot_types": {"A": {"capabilities": {"weld": 1, "paint": 1}}},
    "robots": {"A1": "A"},
    "global_tasks": {
        "fix": {"parameters": ["part"], "needs": {"weld($part)": {}}},
        "coat": {
            "parameters": ["part", "colour"],
            "needs": {"paint($part, $colour)": {"max": 2}, "weld($last)": {}},
        },
        "unused": {"needs": {"weld(1)": {}}},
    },
    "subtrees": {
        "mend": {"parameters": ["part"], "tree": {"Fallback": ["fix($part)", "fix($last)"]}},
        "all": {
            "parameters": ["items"],
            "tree": {"Sequence": {"for_each": {"i": "$items"}, "do": {"SubTree": "mend($i)"}}},
        },
    },
}


def load(tree: Any, **changes: Any) -> Mission:
    """A mission with this tree. JSON is YAML, so plain data will do."""
    text = json.dumps({**HEAD, **changes, "tree": tree})
    return mission_from_yaml(text, "m.yaml", Path("/nowhere"))


def shape(spec: NodeSpec) -> Any:
    """A tree as nested tuples, leaves as their subjects."""
    if not spec.children:
        return spec.subject
    return (spec.name or str(spec.kind), *(shape(child) for child in spec.children))


def expanded(tree: Any, **changes: Any) -> Any:
    return shape(load(tree, **changes).tree.spec())


@pytest.mark.parametrize("kind", sorted(CONTROLS))
def test_for_each_works_on_every_control_node(kind: Kind) -> None:
    tree = {str(kind): {"for_each": {"p": "$parts"}, "do": "fix($p)"}}
    assert expanded(tree) == (str(kind), "fix(1)", "fix(2)")


def test_for_each_repeats_a_list_of_nodes_after_the_children() -> None:
    tree = {
        "Sequence": {
            "children": ["fix(0)"],
            "for_each": {"p": [5, 6]},
            "do": ["fix($p)", {"Condition": "broken($p)"}],
        }
    }
    expected = ("Sequence", "fix(0)", "fix(5)", "broken(5)", "fix(6)", "broken(6)")
    assert expanded(tree) == expected


def test_for_each_over_two_lists_takes_every_combination_the_first_slowest() -> None:
    loop = {"for_each": {"p": "$parts", "c": "$colours"}, "do": "coat($p, $c)"}
    assert expanded({"Sequence": loop}) == (
        "Sequence",
        *("coat(1,red)", "coat(1,blue)", "coat(2,red)", "coat(2,blue)"),
    )


def test_loops_nest_and_inner_names_hide_outer_ones() -> None:
    inner = {"Fallback": {"for_each": {"p": [7, 8]}, "do": "fix($p)"}}
    tree = {"Sequence": {"for_each": {"p": [1]}, "do": ["fix($p)", inner]}}
    assert expanded(tree) == ("Sequence", "fix(1)", ("Fallback", "fix(7)", "fix(8)"))


def test_a_subtree_sees_its_parameters_and_those_of_the_mission_only() -> None:
    assert expanded({"SubTree": "mend(3)"}) == ("mend(3)", ("Fallback", "fix(3)", "fix(9)"))
    # The caller's loop variable does not reach into the subtree, even by the same name.
    loop = {"for_each": {"last": [5]}, "do": {"SubTree": "mend($last)"}}
    assert expanded({"Sequence": loop})[1] == ("mend(5)", ("Fallback", "fix(5)", "fix(9)"))
    subtrees = {"s": {"tree": "fix($p)"}}
    with pytest.raises(FileError, match=r"unknown parameter \$p"):
        load({"Sequence": {"for_each": {"p": [1]}, "do": {"SubTree": "s"}}}, subtrees=subtrees)


def test_a_subtree_takes_a_list() -> None:
    def mend(part: int) -> Any:
        return (f"mend({part})", ("Fallback", f"fix({part})", "fix(9)"))

    assert expanded({"SubTree": "all($parts)"}) == ("all([1 2])", ("Sequence", mend(1), mend(2)))


def test_an_action_may_be_written_long() -> None:
    assert expanded({"Sequence": [{"Action": "fix(1)"}, "fix( 2 )"]}) == expanded(
        {"Sequence": ["fix(1)", {"Action": "fix(2)"}]}
    )


def test_names_may_hold_parameters() -> None:
    node = {"Fallback": {"name": "part $p of $parts", "children": ["fix($p)"]}}
    tree = {"Sequence": {"name": "everything", "for_each": {"p": [4]}, "do": node}}
    assert expanded(tree) == ("everything", ("part 4 of [1 2]", "fix(4)"))


def test_values_become_arguments_in_one_way() -> None:
    tree = {"Sequence": ["fix($on)", "fix($of)", "fix($last)", "fix(x$last)", "fix(01)"]}
    assert expanded(tree) == (
        "Sequence",
        *("fix(true)", "fix(0.5)", "fix(9)", "fix(x9)", "fix(01)"),
    )


@pytest.mark.parametrize(("success", "limit"), [("all", 3), ("any", 1), (2, 2), (3, 3), (None, 3)])
def test_success_of_a_parallel(success: Any, limit: int) -> None:
    body = {"for_each": {"p": [1, 2, 3]}, "do": "fix($p)"}
    body |= {} if success is None else {"success": success}
    assert load({"Parallel": body}).tree.nodes[0].limit == limit


def test_a_parallel_as_a_list_needs_all() -> None:
    assert load({"Parallel": ["fix(1)", "fix(2)"]}).tree.nodes[0].limit == 2


def test_every_decorator() -> None:
    tree = {
        "Sequence": [
            {"RetryUntilSuccessful": {"attempts": -1, "do": "fix(1)", "name": "stubborn"}},
            {"Repeat": {"cycles": 2, "do": {"Inverter": {"Condition": "nominal"}}}},
            {"Timeout": {"seconds": 0.25, "do": {"ForceSuccess": "fix(1)"}}},
            {"ForceFailure": {"KeepRunningUntilFailure": "fix(1)"}},
        ]
    }
    nodes = [
        (node.kind, node.limit, node.timeout_us)
        for node in load(tree).tree.nodes
        if node.kind not in (Kind.ACTION, Kind.CONDITION, Kind.SEQUENCE)
    ]
    assert nodes == [
        (Kind.RETRY, -1, 0),
        (Kind.REPEAT, 2, 0),
        (Kind.INVERTER, 0, 0),
        (Kind.TIMEOUT, 0, 250_000),
        (Kind.FORCE_SUCCESS, 0, 0),
        (Kind.FORCE_FAILURE, 0, 0),
        (Kind.KEEP_RUNNING_UNTIL_FAILURE, 0, 0),
    ]
    assert load(tree).tree.nodes[1].name == "stubborn"


def test_global_tasks_are_those_that_the_tree_mentions_once_each_in_its_order() -> None:
    tree = {"Sequence": ["fix(2)", "coat(1, red)", "fix(2)", {"SubTree": "mend(1)"}]}
    tasks = load(tree).global_tasks
    assert list(tasks) == ["fix(2)", "coat(1,red)", "fix(1)", "fix(9)"]
    needs = [(n.local_task, n.min_robots, n.max_robots) for n in tasks["coat(1,red)"].needs]
    assert needs == [("paint(1,red)", 1, 2), ("weld(9)", 1, 1)]


def test_a_parameter_of_a_task_hides_one_of_the_mission() -> None:
    tasks = {"fix": {"parameters": ["last"], "needs": {"weld($last)": {}}}}
    (task,) = load("fix(3)", global_tasks=tasks, subtrees={}).global_tasks.values()
    assert task.needs[0].local_task == "weld(3)"


def test_parameters_reach_the_robots_as_they_are() -> None:
    parameters = {"b": [1, {"z": None, "a": True}], "a": "x y", "parts": [], "last": 1}
    mission = load("fix(1)", parameters=parameters)
    assert mission.parameters == parameters
    assert list(mission.parameters) == ["a", "b", "last", "parts"]


@given(st.decimals(min_value="0.000001", max_value=1_000_000, places=6))
def test_micro_units_are_exact(value: Decimal) -> None:
    assert to_micro(float(str(value))) == int(value * MICRO)


@pytest.mark.parametrize("value", [1e-7, 0.1234567, 1.0000005])
def test_what_micro_units_cannot_hold_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="at most 6 decimals"):
        to_micro(value)


@given(st.booleans() | st.integers(-(2**63), 2**63) | st.floats(allow_nan=False))
def test_every_number_is_a_valid_argument(value: float) -> None:
    ground = call_text("x", [argument_text(value)])
    assert split_call(ground) == ("x", (argument_text(value),))


@pytest.mark.parametrize("value", ["", "a b", "a,b", "x" * 65, "ä", None, [], {}])
def test_other_values_are_no_arguments(value: Any) -> None:
    with pytest.raises(ValueError, match="an argument"):
        argument_text(value)


names = st.from_regex(r"[a-z_][a-z0-9_]{0,5}", fullmatch=True)


@given(names, st.lists(st.from_regex(r"[A-Za-z0-9_.+-]{1,8}", fullmatch=True), max_size=8))
def test_calls_split_as_the_core_splits_them(name: str, arguments: list[str]) -> None:
    ground = call_text(name, arguments)
    assert split_template(ground) == split_call(ground) == (name, tuple(arguments))


def _loop(node: Any, kind: str) -> Any:
    return {kind: {"for_each": {"p": [1, 2]}, "do": [node, "fix($p)"]}}


trees = st.recursive(
    st.sampled_from(
        ["fix(1)", "fix($last)", {"Condition": "broken(2)"}, {"SubTree": "all($parts)"}]
    ),
    lambda inner: st.one_of(
        st.builds(lambda nodes: {"Sequence": nodes}, st.lists(inner, min_size=1, max_size=3)),
        st.builds(_loop, inner, st.sampled_from(["Sequence", "Fallback", "Parallel"])),
        st.builds(lambda node: {"Inverter": node}, inner),
        st.builds(lambda node, n: {"Repeat": {"cycles": n, "do": node}}, inner, st.just(-1)),
        st.builds(lambda node: {"Timeout": {"seconds": 1.5, "do": node}}, inner),
    ),
    max_leaves=6,
)


@given(trees)
def test_compiling_keeps_every_tree_and_its_digest(tree: Any) -> None:
    mission = load(tree)
    text = compile_mission(mission)
    again = mission_from_compiled(text, "m.json")
    assert again == mission
    assert again.digest == mission.digest
    assert compile_mission(again) == text


@given(trees)
def test_expanded_trees_are_ground_and_declare_all_they_mention(tree: Any) -> None:
    mission = load(tree)
    for node in mission.tree.nodes:
        assert "$" not in node.name + node.subject
        if node.kind is Kind.ACTION:
            assert node.subject in mission.global_tasks
        if node.kind is Kind.CONDITION:
            assert mission.entries.is_condition(node.subject)
    assert {node.subject for node in mission.tree.actions()} == set(mission.global_tasks)
