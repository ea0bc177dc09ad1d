"""Checks that bindings fit the ROS types, before a robot starts."""

from __future__ import annotations

from typing import Any

from .values import UnfitError, check_field, fill, find_type

# For each kind of task: the parts of its type for request, result and feedback.
PARTS = {
    "action": ("Goal", "Result", "Feedback"),
    "srv": ("Request", "Response", None),
    "msg": (None, None, None),
}


def problems_of(bind: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the problems of the bindings, each with `place` in the robot's file and `text`."""
    found: list[dict[str, Any]] = []
    for task in bind["tasks"]:
        _check_task(task, found)
    for topic in bind["topics"]:
        kind = _type(topic["type"], "msg", topic["type_place"], found)
        if kind is not None:
            _check_fields(kind, topic["fields"], found)
    return found


def _check_task(task: dict[str, Any], found: list[dict[str, Any]]) -> None:
    kind = _type(task["type"], task["kind"], task["type_place"], found)
    if kind is None:
        return
    body, result, feedback = PARTS[task["kind"]]
    texts = set()
    for each in task["bodies"]:
        try:
            fill(getattr(kind, body)() if body else kind(), each["body"], has_open=True)
        except UnfitError as problem:
            # An error in the written message occurs again with every value: report it once.
            if str(problem) in texts:
                continue
            texts.add(str(problem))
            if each["is_written"]:
                place, text = [*each["place"], *problem.path], problem.what
            else:
                place, text = each["place"], str(problem)
            found.append({"place": place, "text": text})
    if result:
        _check_fields(getattr(kind, result), task["result"], found)
    if feedback:
        _check_fields(getattr(kind, feedback), task["feedback"], found)


def _check_fields(kind: Any, fields: list[Any], found: list[dict[str, Any]]) -> None:
    for path, place, *compared in fields:
        try:
            check_field(kind, path, *compared)
        except UnfitError as problem:
            found.append({"place": place, "text": str(problem)})


def _type(name: str, kind: str, place: list[Any], found: list[dict[str, Any]]) -> Any:
    try:
        return find_type(name, kind)
    except UnfitError as problem:
        found.append({"place": place, "text": str(problem)})
        return None
