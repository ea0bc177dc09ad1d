"""Bindings against types, before anything begins."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.adapters.ros2.bridge.checks import problems_of

pytestmark = pytest.mark.usefixtures("messages")


def body(data: Any, *place: str) -> dict[str, Any]:
    """A message to be checked, and where it stands."""
    return {"place": list(place), "body": data, "is_written": place[:1] != ("values",)}


def task(**changes: Any) -> dict[str, Any]:
    good: dict[str, Any] = {
        "id": "go",
        "kind": "action",
        "type": "test_robots/action/Drive",
        "type_place": ["local_tasks", "go", "type"],
        "bodies": [
            {
                "is_written": True,
                "place": ["local_tasks", "go", "goal"],
                "body": {"pose": "$place"},
            },
            {
                "is_written": False,
                "place": ["values", "place", "gate"],
                "body": {"pose": {"position": {"x": 1}}},
            },
        ],
        "feedback": [["left", ["local_tasks", "go", "progress"]]],
        "result": [["error_msg", ["local_tasks", "go", "reason"]]],
    }
    return good | changes


TOPIC = {"type": "test_robots/msg/Scan", "type_place": ["conditions", "near", "type"]}


def test_what_fits() -> None:
    look = task(kind="srv", type="test_robots/srv/Look", result=[["success", []]])
    look["bodies"] = [body({"name": "door"})]
    publish = task(kind="msg", type="test_robots/msg/Point")
    publish["bodies"] = [body({"x": 3})]
    topic = TOPIC | {"fields": [["ranges[0]", ["conditions", "near", "expression"]]]}
    assert problems_of({"tasks": [task(), look, publish], "topics": [topic]}) == []


def test_each_problem_has_its_place() -> None:
    bodies = [
        {
            "is_written": True,
            "place": ["local_tasks", "go", "goal"],
            "body": {"pose": {"positon": {}}},
        },
        {
            "is_written": False,
            "place": ["values", "place", "gate"],
            "body": {"pose": {"positon": {}}},
        },
        body({"speed": "fast"}, "values", "place", "yard"),
    ]
    bad = task(
        bodies=bodies,
        feedback=[["lef", ["local_tasks", "go", "progress"]]],
        result=[["error", ["local_tasks", "go", "reason"]]],
    )
    topic = TOPIC | {"fields": [["rangs", ["conditions", "near", "expression"]]]}
    found = problems_of({"tasks": [bad], "topics": [topic]})
    # What is wrong as written is not told again of each value.
    assert [each["place"] for each in found] == [
        ["local_tasks", "go", "goal", "pose", "positon"],
        ["values", "place", "yard"],
        ["local_tasks", "go", "reason"],
        ["local_tasks", "go", "progress"],
        ["conditions", "near", "expression"],
    ]
    assert found[0]["text"].startswith("there is no field 'positon'")
    assert found[1]["text"] == "speed: a number is expected, not 'fast'"


def test_nothing_is_said_of_what_belongs_to_an_unknown_type() -> None:
    bad = task(type="test_robots/action/Fly", result=[["x", []]])
    topic = {**TOPIC, "type": "no_msgs/msg/Scan", "fields": [["x", []]]}
    found = problems_of({"tasks": [bad], "topics": [topic]})
    assert [each["place"] for each in found] == [bad["type_place"], TOPIC["type_place"]]
    assert "test_robots has no action Fly" in found[0]["text"]


def test_a_text_is_not_compared_with_a_number() -> None:
    fields = [["error_msg", ["success"], "a number"], ["error_code", ["reason"], "a text"]]
    bad = task(bodies=[], result=[*fields, ["error_msg", [], "a text"]])
    assert [each["text"] for each in problems_of({"tasks": [bad], "topics": []})] == [
        "m.error_msg: is a text (string), and is compared with a number",
        "m.error_code: is a number (uint16), and is compared with a text",
    ]
