"""From a ground local task to a message."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.binding import FillError, KnownValues
from mrbt_mesh.adapters.ros2.binding_file import TaskBinding

TABLES: dict[str, dict[str, Any]] = {"place": {"gate": {"x": 1.0, "at": {"yaw": 0.5}}, "3": 7}}
BINDING = TaskBinding(
    action="/$robot/go",
    type="a_msgs/action/Go",
    parameters=["place", "tool"],
    goal={"pose": {"x": "$place.x", "yaw": "$place.at.yaw"}, "tool": "$tool", "by": "it: $robot"},
    sets={"seen($place)": True},
)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(alphabet="abc $"),
    lambda inner: st.lists(inner) | st.dictionaries(st.text("xyz"), inner),
    max_leaves=8,
)


def test_values_tables_and_texts() -> None:
    found = BINDING.filled({"robot": "A1"}, ("gate", "drill"), TABLES)
    assert found.body == {"pose": {"x": 1.0, "yaw": 0.5}, "tool": "drill", "by": "it: A1"}
    assert found.sets == {"seen(gate)": True}
    assert found.on_cancel is None


def test_texts_of_tables_are_filled_in_as_well() -> None:
    binding = BINDING.model_copy(update={"parameters": ["place"], "goal": {"to": "$place"}})
    tables = {"place": {"gate": {"frame": "$robot/map", "sign": "$place, $$5"}}}
    found = binding.filled({"robot": "A1"}, ("gate",), tables)
    assert found.body == {"to": {"frame": "A1/map", "sign": "gate, $5"}}


def test_a_whole_value_of_a_table() -> None:
    binding = BINDING.model_copy(
        update={"parameters": ["place"], "goal": {"n": "$place", "all": ["$place"]}}
    )
    assert binding.filled({}, ("3",), TABLES).body == {"n": 7, "all": [7]}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("gate",), "the file has other parameters: place, tool"),
        (("gat", "drill"), "values/place has no 'gat'; did you mean 'gate'?"),
        (("3", "drill"), "$place.x: 3 has no 'x'"),
    ],
)
def test_arguments_that_lead_to_nothing(arguments: tuple[str, ...], said: str) -> None:
    with pytest.raises(FillError) as error:
        BINDING.filled({"robot": "A1"}, arguments, TABLES)
    assert said in str(error.value)


def test_a_part_of_what_has_no_table() -> None:
    with pytest.raises(FillError, match="values has no table for tool"):
        KnownValues({"tool": "drill"}, TABLES).data("$tool.x")


@given(PLAIN)
def test_what_names_nothing_known_stays_as_it_is(data: Any) -> None:
    assert KnownValues({}).data(data) == _unescaped(data)


def _unescaped(data: Any) -> Any:
    if isinstance(data, str):
        return data.replace("$$", "$")
    if isinstance(data, dict):
        return {key: _unescaped(value) for key, value in data.items()}
    return [_unescaped(value) for value in data] if isinstance(data, list) else data


def test_what_is_checked_beforehand() -> None:
    place = ("local_tasks", "go")
    lacking = dict(BINDING.bodies(place, TABLES))["values", "place", "3"]
    assert str(lacking) == "$place.x: 3 has no 'x'; there are none here"
    tables = {"place": {"gate": TABLES["place"]["gate"]}}
    found = dict(BINDING.bodies(place, tables))
    assert found.keys() == {("local_tasks", "go", "goal"), ("values", "place", "gate")}
    assert found["local_tasks", "go", "goal"] == BINDING.body
    known = found["values", "place", "gate"]
    assert known == {"pose": {"x": 1.0, "yaw": 0.5}, "tool": "$tool", "by": "it: $robot"}
    stop = TaskBinding(
        topic="/tune", type="a_msgs/msg/Tune", message={"data": 1}, on_cancel={"data": 0}
    )
    assert dict(stop.bodies(place, TABLES)) == {
        ("local_tasks", "go", "message"): {"data": 1},
        ("local_tasks", "go", "on_cancel"): {"data": 0},
    }
