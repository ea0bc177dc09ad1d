"""The map in a mission's `parameters: map`; docs/how-to/watch.md describes its form.

A map of another form is ignored, since missions may use their parameters as they like.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.travel import MAX_PLACES

MAX_LINES, MAX_POINTS = 1_000, 1_000
MAX_TEXT = 64
# The keys that give a place's state: a condition, then two global tasks.
TOLD_BY = ("bad", "checked", "mended")


def map_view(mission: Mission) -> dict[str, Any] | None:
    """Return the mission's map, or None without one.

    It has `lines` (`points`, `kind`, `closed`), `places` (`at`, `label`) and `ways`: the pairs of
    places on the map between which `travel` lists a way.
    """
    given = mission.parameters.get("map")
    if not isinstance(given, Mapping):
        return None
    lines = [line for line in map(_line, _listed(given.get("lines"), MAX_LINES)) if line]
    given_places = _places(mission.parameters)
    places = {
        name: {"at": at, "label": _text(given_places[name].get("label", name))}
        for name, at in places_on_map(mission.parameters).items()
    }
    found = {"lines": lines, "places": places, "ways": _ways(mission, places)}
    return found if lines or places else None


def _ways(mission: Mission, places: Collection[str]) -> list[list[str]]:
    """Return each pair of places once, whichever of its two directions is listed."""
    listed = mission.travel.ways_ms if mission.travel is not None else {}
    pairs = {(min(way), max(way)) for way in listed if way[0] != way[1]}
    return [[*pair] for pair in sorted(pairs) if pair[0] in places and pair[1] in places]


def places_on_map(parameters: Mapping[str, Any]) -> dict[str, list[float]]:
    """Return the coordinates of each place on the map."""
    found = {name: _point(place.get("at")) for name, place in _places(parameters).items()}
    return {name: at for name, at in found.items() if at is not None}


def told_places(mission: Mission) -> dict[str, Mapping[str, Any]]:
    """Return the places whose state follows from a condition or from global tasks, by name."""
    return {
        name: place
        for name, place in _places(mission.parameters).items()
        if any(place.get(key) for key in TOLD_BY)
    }


def place_states(
    places: Mapping[str, Mapping[str, Any]],
    facts: TeamFacts,
    has_succeeded: Callable[[str], bool],
) -> dict[str, str]:
    """Return `unknown`, `good` or `bad` for each of `told_places`.

    `has_succeeded` tells whether a global task has succeeded; it returns False for an unknown name.
    """
    found = {}
    for name, place in places.items():
        bad, checked, mended = (place.get(key) for key in TOLD_BY)
        if isinstance(mended, str) and has_succeeded(mended):
            found[name] = "good"
        elif isinstance(bad, str) and _holds(facts, bad):
            found[name] = "bad"
        else:
            is_good = isinstance(checked, str) and has_succeeded(checked)
            found[name] = "good" if is_good else "unknown"
    return found


def _holds(facts: TeamFacts, condition: str) -> bool:
    return facts.mission.entries.is_condition(condition) and facts.condition(condition)


def _places(parameters: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    given = parameters.get("map")
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
