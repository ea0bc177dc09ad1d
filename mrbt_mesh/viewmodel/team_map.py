"""The map of a mission: what its file says in `parameters: map`. docs/web.md has the form.

Parameters are the mission's own affair: a map that is not of this form is none, and the rest of
the page does not mind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.observer.task_log import TaskState

MAX_LINES, MAX_POINTS, MAX_PLACES = 1_000, 1_000, 1_000
MAX_TEXT = 64


def map_view(mission: Mission) -> dict[str, Any] | None:
    """Lines (`points`, `kind`, `closed`) and places (`at`, `label`), or None without a map."""
    given = mission.parameters.get("map")
    if not isinstance(given, Mapping):
        return None
    lines = [line for line in map(_line, _listed(given.get("lines"), MAX_LINES)) if line]
    places = {}
    for name, place in _places(mission).items():
        at = _point(place.get("at"))
        if at is not None:
            places[name] = {"at": at, "label": _text(place.get("label", name))}
    return {"lines": lines, "places": places} if lines or places else None


def place_states(observer: Observer) -> dict[str, str]:
    """Place -> `unknown`, `good` or `bad`, for places that say what tells."""
    tasks, found = observer.record.task_log.tasks, {}
    for name, place in _places(observer.mission).items():
        bad, checked, mended = (place.get(key) for key in ("bad", "checked", "mended"))
        if not any((bad, checked, mended)):
            continue

        def succeeded(task: Any) -> bool:
            known = tasks.get(task) if isinstance(task, str) else None
            return known is not None and known.state is TaskState.SUCCESS

        if succeeded(mended):
            found[name] = "good"
        elif isinstance(bad, str) and _holds(observer, bad):
            found[name] = "bad"
        else:
            found[name] = "good" if succeeded(checked) else "unknown"
    return found


def _holds(observer: Observer, condition: str) -> bool:
    return observer.mission.knows_condition(condition) and observer.facts.condition(condition)


def _places(mission: Mission) -> dict[str, Mapping[str, Any]]:
    given = mission.parameters.get("map")
    places = given.get("places") if isinstance(given, Mapping) else None
    if not isinstance(places, Mapping) or len(places) > MAX_PLACES:
        return {}
    return {_text(name): place for name, place in places.items() if isinstance(place, Mapping)}


def _line(given: Any) -> dict[str, Any] | None:
    if not isinstance(given, Mapping):
        return None
    points = [_point(point) for point in _listed(given.get("points"), MAX_POINTS)]
    if len(points) < 2 or None in points:
        return None
    kind = given.get("kind") if given.get("kind") in ("street", "outline") else "outline"
    return {"kind": kind, "points": points, "closed": given.get("closed") is True}


def _listed(given: Any, most: int) -> list[Any]:
    return list(given)[:most] if isinstance(given, list | tuple) else []


def _point(given: Any) -> list[float] | None:
    if not isinstance(given, list | tuple) or len(given) != 2:
        return None
    if not all(isinstance(n, int | float) and math.isfinite(n) for n in given):
        return None
    return [float(given[0]), float(given[1])]


def _text(given: Any) -> str:
    return str(given)[:MAX_TEXT]
